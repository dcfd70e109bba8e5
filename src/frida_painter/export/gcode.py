"""A plan as a G-code file, for machines that take one: strokes in order, and every dip a pause or a motion."""

import itertools
from collections.abc import Iterable, Iterator

from frida_painter.hardware.gcode import PREAMBLE, Gcode
from frida_painter.hardware.robot import Waypoints
from frida_painter.palette import to_hex
from frida_painter.plan import Plan
from frida_painter.session.choreography import Action
from frida_painter.session.events import Dipped, StrokePainted
from frida_painter.session.timetable import DRYING


def gcode(
    plan: Plan, actions: Iterable[Action], language: Gcode, *, pauses: bool, ending: Iterable[Waypoints] = ()
) -> str:
    """The plan as a G-code program whose zero, x and y are those of the actions' motions, in millimetres.

    actions: what painting the plan takes. After each layer but the last the machine waits (M0) until a person finds
    it dry. With `pauses` the machine waits at each dip (M0, travelling
    height) until a person has put paint on the brush or changed the pen; without, it dips, rinses and
    wipes itself, as the motions say. ending: what it does after the last stroke. Raises ConfigError
    where a servo does not reach a height.
    """
    head = (
        f"; frida-painter: {len(plan)} strokes in {len(plan.palette)} paints on {plan.canvas}",
        f"; plan {plan.digest[:16]}",
        *(f"; paint {number} {to_hex(color)}" for number, color in enumerate(plan.palette.color, start=1)),
        *PREAMBLE[: 3 if language.flavour == "grbl" else 2],
    )
    todo = list(actions)
    start = language.rise(float(todo[0].motions[0].position[0, 2])) if todo else ()
    ends = set(itertools.accumulate(plan.layers)) - {0, len(plan)}
    body = (line for action in todo for line in _action(plan, action, language, pauses, ends))
    last = (line for motion in ending for line in _motion(motion, language))
    return "\n".join((*head, *start, *body, *last, "; the end", ""))


def _action(plan: Plan, action: Action, language: Gcode, pauses: bool, layer_ends: set[int]) -> Iterator[str]:
    if isinstance(action.done, Dipped) and pauses:
        yield _dip(plan, action.done, language)
        return
    for motion in action.motions:
        yield from _motion(motion, language)
    if isinstance(action.done, StrokePainted) and action.done.done in layer_ends:
        minutes = f"{DRYING / 60:.0f} minutes"
        yield _wait(f"clean the brush, and let this layer dry for {minutes} before the next one", language)


def _motion(motion: Waypoints, language: Gcode) -> Iterator[str]:
    yield f"; {motion.label}"
    yield from (line for _, line in language.lines(motion))


def _dip(plan: Plan, dip: Dipped, language: Gcode) -> str:
    clean = "clean the brush, then " if dip.cleaned else ""
    return _wait(f"{clean}dip into paint {dip.paint + 1} {to_hex(plan.palette.color[dip.paint])}", language)


def _wait(text: str, language: Gcode) -> str:
    # Marlin shows the words behind M0 on its display; GRBL takes them for a comment in brackets only.
    return f"M0 {text}" if language.flavour == "marlin" else f"M0 ({text})"
