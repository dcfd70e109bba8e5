"""Steps of a machine's setup: a person guides the tip to canvas, wells and lightest touch; then strokes test it all.

Each step is a dialogue of its own, which takes a layout and returns a better one. A step that is left changes nothing.
Every motion is checked against the layout before it is sent, and the guard of the easel's process checks it again.
"""

from collections.abc import Generator, Iterator
from dataclasses import dataclass, replace

import numpy as np
import torch

from frida_painter.brush.kinds import BrushKind
from frida_painter.calibration import SurfaceMap
from frida_painter.canvas_size import CanvasSize
from frida_painter.easel.connecting import find_zero, split_jog
from frida_painter.easel.dialogue import (
    Answer,
    Choose,
    Confirm,
    Guide,
    GuideMove,
    SetupQuestion,
    SetupStep,
)
from frida_painter.errors import CalibrationError, ConfigError, WorkspaceViolation
from frida_painter.hardware.easel import Easel
from frida_painter.hardware.gateway import RobotGateway
from frida_painter.hardware.layout import Layout
from frida_painter.hardware.motion import Motion
from frida_painter.hardware.robot import Feeler, Point, Sense, Waypoints, ZeroedRobot
from frida_painter.session.outline import plan_outlines
from frida_painter.strokes import Strokes
from frida_painter_calibration.procedures.surface import HOW_IT_FEELS, feel, lower, surface

TEST_STROKES = 3
"""Number of the test strokes: light, middle and hard."""
MAX_WELLS = 12
"""Greatest number of wells in one marked row."""
_NEAR = 0.008  # metres above the canvas at which the search for the touch begins
_JOGGING = 0.02  # m/s
_DEEPEST = 0.05
_ROOM = 2.0  # metres of a person's jogging along one axis in all
_MARGIN = 0.012  # metres between a test stroke and the edge of the canvas


@dataclass
class Bench:
    """Machine that is being set up: its connected easel, and what is known of it so far.

    feels: how the machine feels a touch; None if it does not, or is not to
    surface: height map of an uneven canvas; None if it is flat
    """

    easel: Easel
    layout: Layout
    feels: Sense | None = None
    surface: SurfaceMap | None = None

    def within_box(self) -> Easel:
        """Returns the easel in the present layout, with the whole box of the machine as its bounds."""
        workcell = self.layout.workcell()
        box = replace(workcell.workspace, lower=self.layout.lower, upper=self.layout.upper)
        known = replace(
            self.easel.calibration,
            touch_height=self.layout.touch,
            press_height=self.layout.press,
            canvas=workcell.canvas,
            surface=self.surface,
        )
        return replace(self.easel, workspace=box, calibration=known, canvas=workcell.canvas)

    def go(self, label: str, *places: Point, speed: float | None = None) -> None:
        """Moves the tip through the places. Raises WorkspaceViolation before anything moves, RobotError."""
        pace = self.layout.travel_speed if speed is None else speed
        self.perform(Waypoints(label, np.array(places, np.float64), pace), lowest=self.layout.lower[2])

    def perform(self, motion: Waypoints, *, lowest: float | None = None) -> None:
        """Makes a motion if it is allowed.

        lowest: robot z that the tip may reach over the canvas; None for the hardest press
        Raises WorkspaceViolation before anything moves, RobotError and its subclasses.
        """
        RobotGateway(self.within_box(), lowest=lowest).perform([motion])

    def pass_over(self, label: str, place: Point) -> None:
        """Moves up, across and to above a place, at travel height."""
        x, y, z = (float(metres) for metres in self.easel.robot.pose())
        high = max(z, self.layout.travel_height)
        across = max(self.layout.travel_height, min(place[2], self.layout.upper[2]))
        self.go(label, (x, y, high), (place[0], place[1], high), (place[0], place[1], across))


def settle_zero(bench: Bench, corner: Point | None, *, marked: bool) -> SetupStep[None]:
    """Finds the zero of a machine that does not know where it is; asks nothing if it knows.

    corner: position of the tip in the machine's home corner; None if it has limit switches or knows its zero
    marked: True if the canvas was marked before; its corner then gives the zero
    Raises ZeroUnknown if the person does not find it, RobotError and its subclasses.
    """
    robot = bench.easel.robot
    if not isinstance(robot, ZeroedRobot) or (zero := robot.zero()).known:
        return
    if marked or zero.homes or corner is None:
        yield from find_zero(bench.within_box(), robot)
        return
    stands = yield Confirm(
        f"The machine does not know where its tip is: {zero.lost}. Does the tip stand in its home corner now? "
        "(n: you guide it there)"
    )
    told = "Guide the tip into its home corner. The numbers count from where it stands now."
    gone, again = np.zeros(3), False
    while not stands:
        here = (float(gone[0]), float(gone[1]), float(gone[2]))
        answer = yield Guide(told, here, (-_ROOM,) * 3, (_ROOM,) * 3, again=again)
        if not isinstance(answer, GuideMove):
            raise TypeError(f"A guide is answered with a GuideMove, not {answer!r}.")
        again, stands, left = True, answer.settled, np.array(answer.step)
        for part in split_jog(left):
            robot.jog(part)
        gone += left
    robot.set_zero(np.array(corner))


def try_lift(bench: Bench) -> SetupStep[None]:
    """Lowers the brush halfway and raises it until a person has seen that; a controller cannot tell whether it moves.

    Raises ConfigError if it does not move.
    """
    layout = bench.layout
    x, y, _ = (float(metres) for metres in bench.easel.robot.pose())
    top = layout.upper[2]
    half = (layout.touch + top) / 2
    while True:
        bench.go("lift", (x, y, top), (x, y, half), (x, y, top))
        moved = yield Confirm("The brush should have gone down halfway, and up again. Did it move?")
        if moved:
            return
        if not (yield Confirm("Look at its plug and its power. Try the lift once more?")):
            raise ConfigError(
                "The lift does not move although the controller took the commands: it is at another pin, or another "
                "kind of lift. Choose another preset of this machine, or correct [lift] of your own one, and begin "
                "again (--anew)."
            )


def guide(bench: Bench, text: str, place: Point) -> Generator[SetupQuestion, Answer, Point]:
    """Moves to above a place, lets the person guide the tip, and returns the position at which it was settled."""
    bench.pass_over("go there", _within(place, bench.layout))
    remark, again = "", False
    while True:
        x, y, z = (float(metres) for metres in bench.easel.robot.pose())
        answer = yield Guide(text, (x, y, z), bench.layout.lower, bench.layout.upper, remark=remark, again=again)
        if not isinstance(answer, GuideMove):
            raise TypeError(f"A guide is answered with a GuideMove, not {answer!r}.")
        if answer.settled:
            return (x, y, z)
        remark, again = "", True
        dx, dy, dz = answer.step
        try:
            bench.go("jog", (x + dx, y + dy, z + dz))
        except WorkspaceViolation as refused:
            remark = f"Not moved: {refused}"


def _within(place: Point, layout: Layout) -> Point:
    x, y, z = np.clip(np.array(place), layout.lower, layout.upper)
    return float(x), float(y), float(z)


def mark_canvas(bench: Bench, size: CanvasSize | None = None) -> SetupStep[Layout]:
    """Returns the layout with the canvas as marked by two corners, or by three if its size is not known."""
    layout = bench.layout
    corners = layout.corners()
    marked: list[Point] = []
    for name in ("bottom left", "bottom right", *(() if size else ("top left",))):
        proposed = corners[name]
        if marked:  # the canvas was moved as a whole
            shift = np.subtract(marked[0], corners["bottom left"])
            proposed = (proposed[0] + float(shift[0]), proposed[1] + float(shift[1]), proposed[2])
        found = yield from guide(
            bench, f"Guide the tip to just above the {name} corner of the canvas, as you see it.", proposed
        )
        marked.append((found[0], found[1], layout.touch))
    left, right, *top = marked
    return layout.with_canvas(left, right, top[0] if top else None, size)


def find_touch(bench: Bench) -> SetupStep[Layout]:
    """Returns the layout with the heights of the lightest touch and the hardest press over the canvas's middle."""
    layout = bench.layout
    place = _middle(layout)
    bench.pass_over("go to the middle of the canvas", place)
    felt = bench.feels is not None and (
        yield Confirm(f"{HOW_IT_FEELS[bench.feels]} Shall it go down until it feels the canvas? (n: you lower it)")
    )
    if felt:
        assert isinstance(bench.easel.robot, Feeler)
        try:
            found = feel(bench.easel.robot, layout.lower[2], "The middle of the canvas")
        except CalibrationError:
            bench.pass_over("rise", place)
            raise
        bench.pass_over("rise", place)
        press = max(found - (layout.touch - layout.press), layout.lower[2])
        return layout.with_touch(round(found, 5), round(press, 5))
    gateway, lowest = RobotGateway(bench.within_box(), lowest=layout.lower[2]), layout.lower[2]
    speed = min(layout.travel_speed, _JOGGING)
    light = "Lower the brush until its tip just touches the canvas (the lightest mark)."
    hard = "Now lower it as far as it may ever be pressed. A pen is hardly pressed: 0.2 mm do."
    touch = yield from lower(gateway, light, lowest, layout.upper[2], speed)
    press = yield from lower(gateway, hard, lowest, touch, speed)
    bench.pass_over("rise", place)
    if not 0 < touch - press <= _DEEPEST:
        raise CalibrationError(
            f"The hardest press was marked {(touch - press) * 1000:.1f} mm below the lightest touch; it is above 0 and "
            f"at most {_DEEPEST * 1000:g} mm below. Repeat this step."
        )
    return layout.with_touch(round(touch, 5), round(press, 5))


def map_surface(bench: Bench) -> SetupStep[SurfaceMap | None]:
    """Returns the height map of an uneven canvas; None if the person finds it flat. Raises the errors of `surface`."""
    if bench.feels == "force":  # it costs the person nothing
        return (yield from surface(bench.within_box())).surface
    uneven = yield Confirm(
        "Is the canvas uneven or tilted, by more than the brush forgives? Nine points are then measured.",
        proposal=False,
    )
    if not uneven:
        return None
    return (yield from surface(bench.within_box(), felt=bench.feels is not None)).surface


def mark_paint(bench: Bench) -> SetupStep[Layout]:
    """Returns the layout with marked wells, water and rag. Wells stand in a row, evenly from the first to the last."""
    layout = bench.layout
    proposed = layout.paint.wells[:MAX_WELLS]
    counts = tuple(str(number) for number in range(1, MAX_WELLS + 1))
    answer = yield Choose("How many wells of paint (or pens) stand in a row?", counts, len(proposed) - 1)
    count = int(answer) + 1  # type: ignore[arg-type]
    first = yield from guide(bench, "Guide the tip into the first well, as deep as it shall dip.", proposed[0])
    wells = [first]
    if count > 1:
        last = proposed[min(count, len(proposed)) - 1]
        end = yield from guide(bench, f"Guide the tip into the last well, number {count}.", last)
        wells = [_between(first, end, number / (count - 1)) for number in range(count)]
    water = yield from guide(bench, "Guide the tip into the water.", layout.paint.water)
    rag = yield from guide(bench, "Guide the tip onto the middle of the rag.", layout.paint.rag)
    bench.pass_over("rise", rag)
    return layout.with_paint(wells, water, rag)


def _between(start: Point, end: Point, share: float) -> Point:
    x, y, z = np.array(start) + share * np.subtract(end, start)
    return float(x), float(y), float(z)


def trace(bench: Bench) -> SetupStep[None]:
    """Traces the outline of canvas, wells, water and rag in the air, until the person agrees."""
    while True:
        for motion in outlines(bench):
            bench.perform(motion, lowest=bench.layout.lower[2])
        agreed = yield Confirm(
            "The tip went around the canvas, and over each well, the water and the rag, in the air. Was that right? "
            "(If not, mark the canvas or the wells again: --step canvas, --step paint.)"
        )
        if agreed:
            return
        again = yield Confirm("Trace them once more?", proposal=False)
        if not again:
            raise CalibrationError(
                "The outline was not right; mark the canvas or the wells again, then trace it again."
            )


def outlines(bench: Bench) -> Iterator[Waypoints]:
    """Yields the motions of the trace: around the canvas, then over the wells, the water and the rag."""
    yield from plan_outlines(bench.within_box())
    layout = bench.layout
    places = [*layout.paint.wells, layout.paint.water, layout.paint.rag]
    over = np.array([(x, y, layout.travel_height) for x, y, _ in places])
    yield Waypoints("over the wells", over, layout.travel_speed)


def paint_test(bench: Bench, brush: BrushKind) -> SetupStep[bool]:
    """Paints three strokes on the canvas, from light to hard; returns True if the person finds them right."""
    ready = yield Confirm(
        "Lay a sheet of paper on the canvas, and put paint on the brush (or a pen into the holder). "
        f"{TEST_STROKES} strokes follow, from light to hard. Go on?"
    )
    if not ready:
        return False
    here = bench.within_box()
    motion = Motion(here.workspace, here.calibration)
    strokes = place_strokes(bench.layout.canvas, brush)
    for number in range(TEST_STROKES):
        for part in motion.swift_stroke(strokes, number, f"test stroke {number + 1}"):
            bench.perform(part)
    right = yield Confirm("Are there three strokes, from light to hard, and is nothing bent or torn?")
    return bool(right)


def place_strokes(canvas: CanvasSize, brush: BrushKind) -> Strokes:
    """Returns the test strokes: straight, below one another in the middle of the canvas, from light to hard."""
    shortest, longest = brush.limits.length
    length = min(longest, max(shortest, canvas.width / 3))
    apart = min(brush.width * 1.5, (canvas.height - 2 * _MARGIN) / TEST_STROKES)
    middle = np.array((canvas.width / 2, canvas.height / 2))
    rows = middle[1] + apart * (np.arange(TEST_STROKES)[::-1] - (TEST_STROKES - 1) / 2)
    strokes = Strokes(
        position=torch.tensor(np.c_[np.full(TEST_STROKES, middle[0] - length / 2), rows], dtype=torch.float32),
        angle=torch.zeros(TEST_STROKES),
        length=torch.full((TEST_STROKES,), length),
        bend=torch.zeros(TEST_STROKES),
        thickness=torch.linspace(0.2, 1.0, TEST_STROKES),
        color=torch.zeros(TEST_STROKES, 3),
    )
    return strokes.project(brush.limits, canvas)


def _middle(layout: Layout) -> Point:
    (x, y, z), (u, v, _) = layout.corners()["bottom left"], layout.corners()["top right"]
    return (x + u) / 2, (y + v) / 2, max(z + _NEAR, layout.press)
