import ast
import math
from pathlib import Path

import numpy as np
import pytest

import frida_painter.virtual
from frida_painter.canvas_size import CanvasSize
from frida_painter.errors import ConfigError
from frida_painter.hardware.faults import Bump, Faults, PlacementError
from frida_painter.virtual.camera import CameraSpec
from frida_painter.virtual.studio import StudioSettings, open_studio
from frida_painter.virtual.tabletop import HandNoise

from .hand import CANVAS, Hand

BLACK = [0.08, 0.08, 0.08]


def painted(seed):
    hand = Hand(BLACK, [0.9, 0.8, 0.2], seed=seed, error=None, noise=HandNoise(), camera=CameraSpec((480, 640)))
    for well, y in ((0, 0.03), (1, 0.05)):
        hand.dip(well)
        hand.stroke(0.03, y, 0.05, bend=0.01)
        hand.clean()
    hand.easel.robot.home()
    frame = hand.easel.camera.capture(0.0)
    return frame.image.tobytes(), hand.studio.truth(90).numpy().tobytes(), hand.studio.balance()


def test_one_seed_gives_the_same_bytes_and_another_seed_others():
    assert painted(4) == painted(4)
    assert painted(4)[0] != painted(5)[0]


@pytest.mark.parametrize(("shift", "turn"), [((0.0, 0.0), 0.0), ((0.004, -0.002), 10.0)])
def test_a_mark_lands_where_the_canvas_s_frame_says_shifted_and_turned_about_its_centre(shift, turn):
    hand = Hand(BLACK, brush="fine", error=PlacementError(shift, math.radians(turn)))
    hand.dip(0)
    hand.stroke(0.045, 0.045, 0.03, thickness=0.6)  # Through the centre, along x.
    place = np.argwhere(hand.truth().mean(2) < 0.4)[:, ::-1] * (0.5, -0.5) + (0, 90)
    assert place[:, 0].mean() == pytest.approx(60 + 1000 * shift[0], abs=2.5)  # a little ahead of or behind its path
    assert place[:, 1].mean() == pytest.approx(45 + 1000 * shift[1], abs=0.8)
    along = np.linalg.eigh(np.cov((place - place.mean(0)).T))[1][:, 1]
    assert (math.degrees(math.atan2(along[1], along[0])) + 90 - turn) % 180 == pytest.approx(90, abs=3)


def test_without_a_wish_the_error_is_a_couple_of_millimetres_and_known_to_nobody():
    errors = [open_studio(CANVAS, seed=seed).placement_error for seed in range(4)]
    assert len(set(errors)) == 4
    for error in errors:
        assert 0.0015 <= math.hypot(*error.shift) <= 0.0025
        assert 0.3 <= abs(math.degrees(error.turn)) <= 0.5
    assert open_studio(CANVAS, seed=0).easel.calibration.placement == ((1, 0, 0), (0, 1, 0), (0, 0, 1))


def test_strokes_differ_a_little_from_one_to_the_next():
    hand = Hand(BLACK, brush="fine", noise=HandNoise(0.001, 0.0))
    middles = []
    for k in range(6):
        hand.dip(0)
        before = hand.truth()
        hand.stroke(0.03, 0.012 + 0.013 * k, 0.04)
        middles.append(np.argwhere((before - hand.truth()).mean(2) > 0.4).mean(0)[0] / 2 + 13 * k)
    assert 0.2 < np.std(middles) < 3


def test_the_calibration_is_that_of_the_studio():
    hand = Hand(BLACK)
    calibration = hand.easel.calibration
    assert calibration.brush == "medium"
    assert calibration.touch_height - calibration.press_height == pytest.approx(0.006)
    corners = np.array(calibration.corners)
    assert (corners > 0).all() and (corners < np.array(calibration.photograph)[::-1]).all()
    height = corners[3, 1] - corners[0, 1]
    assert 850 < height < 1150


def test_as_many_paints_as_a_palette_may_have_fit_into_the_wells():
    hand = Hand(*np.linspace(1, 0, 64 * 3).reshape(64, 3).tolist())
    hand.dip(63)
    assert hand.studio.balance().drawn > 0
    empty = Hand(BLACK)
    empty.dip(5)
    assert empty.studio.balance().drawn == 0


@pytest.mark.parametrize("canvas", [CanvasSize(0.03, 0.03), CanvasSize(3.0, 0.5)])
def test_any_canvas_size_can_be_painted_on(canvas):
    hand = Hand(BLACK, canvas=canvas, brush="fine", cell=None, camera=CameraSpec((240, 320)))
    hand.dip(0)
    hand.stroke(0.5 * canvas.width - 0.01, 0.5 * canvas.height, 0.02, thickness=1.0)
    assert hand.studio.canvas.wet_volume > 1
    hand.easel.robot.home()
    assert hand.easel.camera.capture(0.0).image.std() > 10
    assert hand.studio.canvas.dry.size < 3.2e6


@pytest.mark.parametrize(
    "settings", [{"cell": 0.0}, {"cell": math.nan}, {"drying_time": 0.0}, {"drying_time": math.nan}]
)
def test_settings_that_make_no_sense_are_refused(settings):
    with pytest.raises(ConfigError, match=r"allowed|above"):
        StudioSettings(**settings)


def test_reality_shares_no_code_with_the_renderer_that_it_judges():
    allowed = {"virtual", "errors", "registry", "canvas_size", "frames", "calibration", "hardware"}
    allowed |= {"strokes.palette", "system.event_log", "system.images"}
    for module in Path(frida_painter.virtual.__file__).parent.glob("*.py"):
        for node in ast.walk(ast.parse(module.read_text())):
            names = [f"{node.module}.{alias.name}" for alias in node.names] if isinstance(node, ast.ImportFrom) else []
            names += [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            parts = [name.split(".")[1:] for name in names if name.startswith("frida_painter.")]
            ours = {".".join(part[:2]) if part[0] in ("strokes", "system") else part[0] for part in parts}
            assert ours <= allowed, f"{module.name} imports {ours - allowed}"


def test_a_fresh_canvas_is_bare_and_lies_where_the_first_one_did():
    hand = Hand(BLACK, faults=Faults(bumps=(Bump(0, (0.003, 0.0)),)))
    hand.dip(0)
    hand.stroke(0.03, 0.045, 0.04)
    assert hand.studio.truth(60).min() < 0.3
    assert hand.studio.table.knock.shift == (0.003, 0.0)
    assert hand.easel.operator.lay_paper()
    assert hand.studio.truth(60).min() > 0.9
    assert hand.studio.table.knock.shift == (0.0, 0.0)
    balance = hand.studio.balance()
    assert balance.wet + balance.dry == 0 < balance.carried_away
    assert abs(balance.missing) < 1e-3 * balance.drawn
    hand.dip(0)
    hand.stroke(0.03, 0.045, 0.04)
    assert hand.studio.truth(60).min() < 0.3


def test_the_first_brush_paints_as_if_it_were_alone_and_another_one_paints_otherwise():
    alone, two = (
        Hand(BLACK, brush=brush, error=None, seed=3) for brush in ("broad", {"broad": "broad", "thin": "fine"})
    )
    for hand in (alone, two):
        hand.dip(0)
        hand.stroke(0.03, 0.03, 0.05)
        hand.clean()
    assert alone.studio.truth(90).numpy().tobytes() == two.studio.truth(90).numpy().tobytes()
    assert two.easel.calibration.brush == "broad"
    assert two.easel.calibration.of_brush("thin").press_height > two.easel.calibration.press_height
    two.easel.operator.change_brush("thin")
    before = two.studio.truth(180).mean(0)
    two.dip(0)
    two.stroke(0.03, 0.07, 0.05)
    two.easel.operator.change_brush("broad")
    left = two.studio.table.tuft.volume
    two.easel.operator.change_brush("broad")  # it is there already
    assert two.studio.table.tuft.volume == left
    changed = (before - two.studio.truth(180).mean(0)) > 0.3
    rows = changed.any(1).nonzero()
    assert 4 < float(rows.max() - rows.min()) / 2 < 16, "mm; the broad brush leaves more than 20"
    assert abs(two.studio.balance().missing) < 1e-6
    with pytest.raises(ConfigError, match="opened with broad, thin, not with the brush 'medium'"):
        two.easel.operator.change_brush("medium")
    fine, broad = Hand(brush="fine"), Hand(brush="broad")
    assert two.easel.workspace.lower == broad.easel.workspace.lower != fine.easel.workspace.lower, "the deepest counts"
