"""Steps of a machine's setup: a person shows the program the canvas, the heights of touch and press, and the paint.

Every step is a dialogue that changes the layout on its bench. Every motion passes the gateway, within the box of the
machine; the tip may go as deep as the box, because what it must not touch is only being found out.
"""

from collections.abc import Callable, Generator, Iterator
from dataclasses import dataclass, replace

import numpy as np
import torch

from frida_painter.brush.kinds import BrushKind, brush_kind
from frida_painter.calibration import SurfaceMap
from frida_painter.canvas_size import CanvasSize
from frida_painter.easel.connecting import enter_workspace, find_zero, split_jog
from frida_painter.easel.dialogue import Answer, Choose, Confirm, Guide, GuideMove, SetupQuestion, SetupStep
from frida_painter.errors import CalibrationError, ConfigError, WorkspaceViolation
from frida_painter.hardware.easel import Easel
from frida_painter.hardware.gateway import RobotGateway
from frida_painter.hardware.motion import Motion
from frida_painter.hardware.preset import Layout
from frida_painter.hardware.robot import Point, Sense, TouchProbe, Waypoints, ZeroedRobot
from frida_painter.session.outline import plan_outlines
from frida_painter.strokes.strokes import Strokes
from frida_painter_calibration.procedures.surface import HOW_IT_FEELS, JOGGING, feel, lower, surface

TEST_STROKES = 3
"""Number of the test strokes: light, middle and hard."""
MAX_WELLS = 12
"""Greatest number of wells in one marked row."""
_NEAR = 0.008  # metres above the canvas at which the search for the touch begins
_DEEPEST = 0.05
_ROOM = 2.0  # metres of a person's jogging along one axis in all
_MARGIN = 0.012  # metres between a test stroke and the edge of the canvas


@dataclass
class Bench:
    """Machine that is being set up: its connected easel, and what is known of it so far.

    feels: how the machine feels a touch; None if it does not, or is not to
    surface: height map of an uneven canvas; None if it is flat
    size: of the canvas if a person said it; None if three corners are marked
    """

    easel: Easel
    layout: Layout
    feels: Sense | None = None
    surface: SurfaceMap | None = None
    size: CanvasSize | None = None

    def within_box(self) -> Easel:
        """Returns the easel in the present layout, with the whole box of the machine as its bounds."""
        workcell, whole = self.layout.workcell(), self.layout.workspace
        box = replace(workcell.workspace, lower=whole.lower, upper=whole.upper)
        known = replace(
            self.easel.calibration,
            touch_height=self.layout.touch,
            press_height=self.layout.press,
            canvas=workcell.canvas,
            surface=self.surface,
        )
        return replace(self.easel, workspace=box, calibration=known, canvas=workcell.canvas)

    def tip(self) -> Point:
        """Returns the position of the tip in metres. Raises RobotError."""
        x, y, z = (float(metres) for metres in self.easel.robot.pose())
        return x, y, z

    def perform(self, motion: Waypoints, *, lowest: float | None = None) -> None:
        """Makes a motion if it is allowed.

        lowest: robot z that the tip may reach over the canvas; None for the hardest press
        Raises WorkspaceViolation before anything moves, RobotError and its subclasses.
        """
        RobotGateway(self.within_box(), lowest=lowest).perform([motion])

    def go(self, label: str, *places: Point) -> None:
        """Moves the tip through the places at travel speed. Raises the errors of `perform`."""
        motion = Waypoints(label, np.array(places, np.float64), self.layout.workspace.travel_speed)
        self.perform(motion, lowest=self.layout.workspace.lower[2])

    def pass_over(self, label: str, place: Point) -> None:
        """Moves up, across and to above a place, at travel height."""
        x, y, z = self.tip()
        high = max(z, self.layout.travel_height)
        across = max(self.layout.travel_height, min(place[2], self.layout.workspace.upper[2]))
        self.go(label, (x, y, high), (place[0], place[1], high), (place[0], place[1], across))


def settle_zero(bench: Bench, corner: Point | None, *, marked: bool) -> SetupStep[None]:
    """Finds the zero of a machine that does not know where it is, and brings its tip into the box; asks nothing else.

    corner: position of the tip in the machine's home corner; None for the front left end of its travel
    marked: True if the canvas was marked before; its corner then gives the zero
    Raises ZeroUnknown if the person does not find it, RobotError and its subclasses.
    """
    robot = bench.easel.robot
    if not isinstance(robot, ZeroedRobot):
        return
    if not (zero := robot.zero()).known:
        if marked or zero.homes:
            yield from find_zero(bench.within_box(), robot)
        else:
            yield from _find_corner(bench, robot, corner, zero.lost)
    yield from enter_workspace(bench.within_box(), robot)


def _find_corner(bench: Bench, robot: ZeroedRobot, corner: Point | None, lost: str) -> SetupStep[None]:
    """Has the tip guided into the home corner."""
    where = "its home corner"
    if corner is None:  # it has no limit switches
        corner = *bench.layout.workspace.lower[:2], bench.layout.touch
        where = "the front left corner of its travel, just touching the table"
    stands = yield Confirm(
        f"The machine does not know where its tip is: {lost}. Does the tip stand in {where} now? (n: you guide it "
        "there)",
        proposal=False,
    )
    told = f"Guide the tip into {where}. The numbers count from where it stands now."
    gone, again = np.zeros(3), False
    while not stands:
        here = (float(gone[0]), float(gone[1]), float(gone[2]))
        answer = yield Guide(told, here, (-_ROOM,) * 3, (_ROOM,) * 3, again=again)
        assert isinstance(answer, GuideMove)
        again, stands, left = True, answer.settled, np.array(answer.step)
        for part in split_jog(left):
            robot.jog(part)
        gone += left
    robot.set_zero(np.array(corner))


def try_lift(bench: Bench) -> SetupStep[None]:
    """Lowers the brush halfway and raises it until a person has seen that; a controller cannot tell whether it moves.

    Raises ConfigError if it does not move.
    """
    x, y, _ = bench.tip()
    top = bench.layout.workspace.upper[2]
    half = (bench.layout.touch + top) / 2
    while True:
        bench.go("lift", (x, y, top), (x, y, half), (x, y, top))
        if (yield Confirm("The brush should have gone down halfway, and up again. Did it move?")):
            return
        if not (yield Confirm("Look at its plug and its power. Try the lift once more?")):
            raise ConfigError(
                "The lift does not move although the controller took the commands: it is at another pin, or another "
                "kind of lift. Choose another preset of this machine, or correct [lift] of your own one, and begin "
                "again (--anew)."
            )


def guide(bench: Bench, text: str, place: Point) -> Generator[SetupQuestion, Answer, Point]:
    """Moves to above a place, lets the person guide the tip, and returns the position at which it was settled."""
    box = bench.layout.workspace
    x, y, z = np.clip(np.array(place), box.lower, box.upper).tolist()
    bench.pass_over("go there", (x, y, z))
    remark, again = "", False
    while True:
        x, y, z = here = bench.tip()
        answer = yield Guide(text, here, box.lower, box.upper, remark=remark, again=again)
        assert isinstance(answer, GuideMove)
        if answer.settled:
            return here
        remark, again = "", True
        dx, dy, dz = answer.step
        try:
            bench.go("jog", (x + dx, y + dy, z + dz))
        except WorkspaceViolation as refused:
            remark = f"Not moved: {refused}"


def mark_canvas(bench: Bench) -> SetupStep[None]:
    """Has the canvas marked by two corners, or by three if its size is not known."""
    layout, size = bench.layout, bench.size
    corners = layout.corners()
    marked: list[Point] = []
    for name in ("bottom-left", "bottom-right", *(() if size else ("top-left",))):
        x, y, z = corners[name]
        if marked:  # the canvas was moved as a whole
            shift = np.subtract(marked[0], corners["bottom-left"])
            x, y = x + float(shift[0]), y + float(shift[1])
        told = f"Guide the tip to just above the {name} corner of the canvas, as you see it."
        found = yield from guide(bench, told, (x, y, z))
        marked.append((found[0], found[1], layout.touch))
    bench.layout = layout.with_canvas(marked[0], marked[1], None if size else marked[2], size)


def find_touch(bench: Bench) -> SetupStep[None]:
    """Finds the heights of the lightest touch and the hardest press over the canvas's middle."""
    layout = bench.layout
    (x, y, z), (u, v, _) = layout.corners()["bottom-left"], layout.corners()["top-right"]
    place = (x + u) / 2, (y + v) / 2, max(z + _NEAR, layout.press)
    bench.pass_over("go to the middle of the canvas", place)
    lowest, felt = layout.workspace.lower[2], False
    if bench.feels is not None:
        told = f"{HOW_IT_FEELS[bench.feels]} Shall it go down until it feels the canvas? (n: you lower it)"
        felt = (yield Confirm(told, moves=True)) is True
    if felt:
        assert isinstance(bench.easel.robot, TouchProbe)
        try:
            touch = feel(bench.easel.robot, lowest, "The middle of the canvas")
        except CalibrationError:
            bench.pass_over("rise", place)
            raise
        press = max(touch - (layout.touch - layout.press), lowest)
    else:
        gateway, speed = RobotGateway(bench.within_box(), lowest=lowest), min(layout.workspace.travel_speed, JOGGING)
        light = "Lower the brush until its tip just touches the canvas (the lightest mark)."
        hard = "Now lower it as far as it may ever be pressed. A pen is hardly pressed: 0.2 mm do."
        touch = yield from lower(gateway, light, lowest, layout.workspace.upper[2], speed)
        press = yield from lower(gateway, hard, lowest, touch, speed)
    bench.pass_over("rise", place)
    if not felt and not 0 < touch - press <= _DEEPEST:
        raise CalibrationError(
            f"The hardest press was marked {(touch - press) * 1000:.1f} mm below the lightest touch; it is above 0 and "
            f"at most {_DEEPEST * 1000:g} mm below. Repeat this step."
        )
    bench.layout = layout.with_touch(round(touch, 5), round(press, 5))


def map_surface(bench: Bench) -> SetupStep[None]:
    """Measures an uneven canvas; a person tells whether it is one. Raises the errors of `surface`."""
    measured = None
    uneven = bench.feels == "force" or (  # it costs the person nothing
        yield Confirm(
            "Is the canvas uneven or tilted, by more than the brush forgives? Nine points are then measured.",
            proposal=False,
        )
    )
    if uneven:
        here = bench.within_box()
        found = yield from surface(here, felt=bench.feels is not None)
        measured = found.enter(here.calibration).surface
    ends = (measured.lowest, measured.highest) if measured else (0.0, 0.0)
    bench.surface, bench.layout = measured, replace(bench.layout, uneven=ends)


def mark_paint(bench: Bench) -> SetupStep[None]:
    """Has wells, water and rag marked. Wells stand in a row, evenly from the first to the last."""
    layout = bench.layout
    proposed = layout.workspace.wells[:MAX_WELLS]
    counts = tuple(str(number) for number in range(1, MAX_WELLS + 1))
    answer = yield Choose("How many wells of paint (or pens) stand in a row?", counts, len(proposed) - 1)
    count = int(answer) + 1  # type: ignore[arg-type]
    first = yield from guide(bench, "Guide the tip into the first well, as deep as it shall dip.", proposed[0])
    wells = [first]
    if count > 1:
        last = proposed[min(count, len(proposed)) - 1]
        end = yield from guide(bench, f"Guide the tip into the last well, number {count}.", last)
        wells = [(x, y, z) for x, y, z in np.linspace(first, end, count).tolist()]
    water = yield from guide(bench, "Guide the tip into the water.", layout.workspace.water)
    rag = yield from guide(bench, "Guide the tip onto the middle of the rag.", layout.workspace.rag)
    bench.pass_over("rise", rag)
    bench.layout = layout.with_paint(wells, water, rag)


def trace(bench: Bench) -> SetupStep[None]:
    """Traces the outline of canvas, wells, water and rag in the air, until the person agrees."""
    while True:
        for motion in _outlines(bench):
            bench.perform(motion, lowest=bench.layout.workspace.lower[2])
        agreed = yield Confirm(
            "The tip went around the canvas, and over each well, the water and the rag, in the air. Was that right? "
            "(If not, mark the canvas or the wells again: --step canvas, --step paint.)"
        )
        if agreed:
            return
        if not (yield Confirm("Trace them once more?", proposal=False)):
            raise CalibrationError(
                "The outline was not right; mark the canvas or the wells again, then trace it again."
            )


def _outlines(bench: Bench) -> Iterator[Waypoints]:
    """Yields the motions of the trace: around the canvas, then over the wells, the water and the rag."""
    yield from plan_outlines(bench.within_box())
    layout = bench.layout
    places = [*layout.workspace.wells, layout.workspace.water, layout.workspace.rag]
    over = np.array([(x, y, layout.travel_height) for x, y, _ in places])
    yield Waypoints("over the wells", over, layout.workspace.travel_speed)


def paint_test(bench: Bench) -> SetupStep[None]:
    """Paints three strokes on the canvas, from light to hard. Raises ConfigError if the person finds them wrong."""
    ready = yield Confirm(
        "Lay a sheet of paper on the canvas, and put paint on the brush (or a pen into the holder). "
        f"{TEST_STROKES} strokes follow, from light to hard. Go on?",
        moves=True,
    )
    right = False
    if ready:
        here = bench.within_box()
        motion = Motion(here.workspace, here.calibration)
        strokes = place_strokes(bench.layout.canvas, brush_kind(here.calibration.brush))
        for number in range(TEST_STROKES):
            for part in motion.swift_stroke(strokes, number, f"test stroke {number + 1}"):
                bench.perform(part)
        right = (yield Confirm("Are there three strokes, from light to hard, and is nothing bent or torn?")) is True
    if not right:
        raise ConfigError("The test strokes were not right; repeat the touch or the canvas, then paint them again.")


def place_strokes(canvas: CanvasSize, brush: BrushKind) -> Strokes:
    """Returns the test strokes: straight, below one another in the middle of the canvas, from light to hard."""
    shortest, longest = brush.limits.length
    length = min(longest, max(shortest, canvas.width / 3))
    apart = min(brush.width * 1.5, (canvas.height - 2 * _MARGIN) / TEST_STROKES)
    rows = canvas.height / 2 + apart * (np.arange(TEST_STROKES)[::-1] - (TEST_STROKES - 1) / 2)
    start = np.c_[np.full(TEST_STROKES, (canvas.width - length) / 2), rows]
    none = torch.zeros(TEST_STROKES)
    strokes = Strokes(
        torch.tensor(start, dtype=torch.float32), none, none + length, none, torch.linspace(0.2, 1.0, TEST_STROKES),
        torch.zeros(TEST_STROKES, 3),
    )  # fmt: skip
    return strokes.project(brush.limits, canvas)


STEPS: dict[str, tuple[str, Callable[[Bench], SetupStep[None]]]] = {
    "canvas": ("mark the corners of the canvas", mark_canvas),
    "touch": ("find the lightest touch and the hardest press", find_touch),
    "surface": ("measure the canvas if it is uneven", map_surface),
    "paint": ("mark the wells, the water and the rag", mark_paint),
    "trace": ("trace the outlines in the air", trace),
    "strokes": ("paint three test strokes", paint_test),
}
"""Steps of a setup in their order: what a person does in each, and its dialogue."""
