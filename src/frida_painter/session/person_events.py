"""Written events of a person at a painting: regions, changed goals and own strokes."""

import math
from typing import Any

from frida_painter.session.event import Written

PEN_LIMITS: tuple[tuple[str, float, float], ...] = (
    ("place from the left", -1.0, 2.0), ("place from the top", -1.0, 2.0), ("press", 0.0, 1.0),
    ("tilt", 0.0, math.pi / 2), ("direction of its tilt", -100.0, 100.0), ("time", 0.0, 600.0),
)  # fmt: skip
"""Values of each point of a pen: name, least and greatest value; see together.turns.PenStroke."""


class RegionProtected(Written):
    """A person drew a region: no stroke may touch it, or, with `only`, strokes may be only there.

    region: file of the drawing in the painting's folder. None: nothing is protected any more.
    picture: picture for the page.
    """

    region: str | None
    only: bool = False
    picture: str | None = None


class GoalChanged(Written):
    """A person changed the goal.

    goal: folder of the goal in the painting's folder.
    wish: request of the page.
    done: number of painted strokes.
    facts: descriptions of the goal, and of how its pictures were made.
    """

    goal: str
    wish: dict[str, Any]
    done: int = 0
    facts: tuple[str, ...] = ()


class RequestTaken(Written):
    """The painter does what a person asked for in a pause; if it breaks off meanwhile, a resumed painting does it.

    request: command of the page; empty if the last one is done, or was refused.
    """

    request: dict[str, Any]


class PersonStrokeBegan(Written):
    """A person's stroke will now be painted on the canvas of a simulated easel, after `done` strokes of the robot.

    number: from 1, over the whole painting.
    stroke: as in hardware.easel.PersonStroke.
    color: sRGB of its paint.
    """

    number: int
    done: int
    stroke: dict[str, Any]
    color: tuple[float, float, float]


class PersonStrokePainted(Written):
    """The person's stroke of this number is on the canvas, after `done` strokes of the robot."""

    number: int
    done: int


class PersonPaintShown(Written):
    """A person painted with a real brush, as two photographs of a pause show.

    picture: the canvas with a line around it, for the page.
    share: of the canvas.
    """

    picture: str
    share: float
