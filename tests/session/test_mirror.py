import numpy as np
import torch

from frida_painter.brush.kinds import brush_kind
from frida_painter.canvas_size import CanvasSize
from frida_painter.session.hand import Hand
from frida_painter.session.observer import CanvasObserver
from frida_painter.strokes.palette import Palette
from frida_painter.strokes.plan import Plan
from frida_painter.strokes.strokes import Strokes
from frida_painter.virtual.studio import StudioSettings, open_studio

CANVAS = CanvasSize(0.12, 0.09)
# The F on the canvas, metres, y up: its stem from the foot upwards, its upper and its middle arm.
STEM, UPPER, MIDDLE = ((0.025, 0.035), 0.045), ((0.025, 0.08), 0.035), ((0.025, 0.06), 0.022)
HALF = 3  # pixels of a millimetre


def the_plan() -> Plan:
    """The F as three strokes; only here the conventions of the canvas's frame are written down."""
    bars = (STEM, UPPER, MIDDLE)
    kind = brush_kind("fine")
    palette = Palette(torch.tensor([[0.05, 0.05, 0.05]]))
    strokes = Strokes(
        position=torch.tensor([start for start, _ in bars]),
        angle=torch.tensor([torch.pi / 2, 0.0, 0.0]),
        length=torch.tensor([length for _, length in bars]),
        bend=torch.zeros(3),
        thickness=torch.full((3,), 0.8),
        color=palette.color.expand(3, 3),
    )
    return Plan.of(strokes, palette, torch.zeros(3).long(), canvas=CANVAS, brush="fine", limits=kind.limits)


def drawn(rows: int = 90, columns: int = 120) -> np.ndarray:
    """The F as a person sees it, upright: 1 where it is inked, [rows, columns], row 0 at the top."""
    ink = np.zeros((rows, columns))
    (left, low), height = STEM
    top, bottom, column = (round(1000 * metres) for metres in (CANVAS.height - low - height, CANVAS.height - low, left))
    ink[top:bottom, column - HALF : column + HALF] = 1
    for (left, above), width in (UPPER, MIDDLE):
        row, column, end = (round(1000 * metres) for metres in (CANVAS.height - above, left, left + width))
        ink[row - HALF : row + HALF, column:end] = 1
    return ink


def test_the_letter_as_drawn_is_an_f() -> None:
    """Its ink lies to the left and to the top, and it is none of its own mirror images."""
    ink = drawn()
    rows, columns = np.nonzero(ink)
    assert rows.mean() < 44 and columns.mean() < 58
    for flipped in (ink[:, ::-1], ink[::-1], ink[::-1, ::-1]):
        assert np.corrcoef(ink.ravel(), flipped.ravel())[0, 1] < 0.5


def test_an_f_painted_through_the_whole_path_comes_back_as_an_f() -> None:
    """Fault F36: a mirrored canvas.

    Frames, motion, robot, paint, camera, rectification: an error of sign in any of them mirrors the letter.
    """
    studio = open_studio(CANVAS, "fine", seed=3, settings=StudioSettings(cell=0.4))
    easel = studio.easel
    easel.robot.connect()
    easel.camera.connect()
    hand, observer = Hand(easel, brush_kind("fine")), CanvasObserver(easel)
    plan = the_plan()
    hand.step_aside()
    observer.look(hand.last_motion, 90)
    easel.operator.fill_wells(plan.palette)
    for action in hand.prepare(plan, 0, 3):
        hand.perform(action)
    hand.step_aside()
    seen = observer.look(hand.last_motion, 90)
    ink = 1 - seen.mean(0).numpy()

    def alike(letter: np.ndarray) -> float:
        return float(np.corrcoef(ink.ravel(), letter.ravel())[0, 1])

    letter = drawn()
    right, mirrored = alike(letter), [alike(letter[:, ::-1]), alike(letter[::-1]), alike(letter[::-1, ::-1])]
    assert right > 0.75
    assert max(mirrored) < 0.4
    # The transposed letter, turned every way, is the other family of errors.
    square, middle = ink[:, :90], letter[:, :90]
    assert np.corrcoef(square.ravel(), middle.ravel())[0, 1] > 0.75
    for turned in (np.rot90(middle), np.rot90(middle, 3), middle.T, np.rot90(middle, 2).T):
        assert np.corrcoef(square.ravel(), turned.ravel())[0, 1] < 0.5
