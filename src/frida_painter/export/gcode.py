"""A plan as a G-code file, for machines that take one: strokes in order, and every dip a pause or a motion."""

from collections.abc import Callable, Iterable, Iterator

import torch

from frida_painter.hardware.gcode import PREAMBLE, Gcode
from frida_painter.hardware.robot import Waypoints
from frida_painter.palette import Palette, to_hex
from frida_painter.plan import WHITE, Layer, Plan
from frida_painter.session.choreography import Action
from frida_painter.session.events import Dipped, StrokePainted
from frida_painter.session.timetable import DRYING


def gcode(
    plan: Plan,
    actions: Iterable[Action],
    language: Gcode,
    *,
    pauses: bool,
    ending: Iterable[Waypoints] = (),
    drying: float = DRYING,
    change: Callable[[str, str], Iterable[Waypoints]] | None = None,
) -> str:
    """The plan as a G-code program whose zero, x and y are those of the actions' motions, in millimetres.

    actions: what painting the plan takes. A plan of several brushes waits (M0) for the first of them. After each
    layer but the last the machine waits until a person finds it dry. With `pauses` the machine waits at each dip
    (travelling height) until a person has put paint on the brush or changed the pen; without, it dips, rinses and
    wipes itself, as the motions say. ending: what it does after the last stroke; drying: seconds that a layer is let
    dry; change: what the machine does to put back one brush ("" for none) and take another, None where a person does.
    Raises ConfigError where a servo does not reach a height.
    """
    head = (
        f"; frida-painter: {len(plan)} strokes in {len(plan.palette)} paints on {plan.canvas}",
        f"; plan {plan.digest[:16]}",
        *_canvas(plan),
        *_paints(plan),
        *PREAMBLE[: 3 if language.flavour == "grbl" else 2],
    )
    todo = list(actions)
    start = language.rise(float(todo[0].motions[0].position[0, 2])) if todo else ()
    body = _body(plan, todo, language, pauses, drying, change)
    last = _motions(ending, language)
    return "\n".join((*head, *start, *body, *last, "; the end", ""))


def _canvas(plan: Plan) -> Iterator[str]:
    """On what it is painted, where that is no bare canvas."""
    if plan.ground != WHITE:
        yield f"; ground {to_hex(torch.tensor(plan.ground))}: tone the whole canvas in it, and let it dry, before"


def _paints(plan: Plan) -> Iterator[str]:
    """What is in which well, and with which brush it is painted, layer by layer where they differ."""
    before: Layer | None = None
    for number, layer in enumerate(plan.layers, start=1):
        if len(plan.brushes) > 1:
            yield f"; layer {number}: {layer.brush} brush"
        if before is None or layer.paints != before.paints:
            yield from (f"; paint {well} {to_hex(color)}" for well, color in enumerate(plan.wells(layer).color, 1))
        before = layer


def _body(
    plan: Plan,
    actions: Iterable[Action],
    language: Gcode,
    pauses: bool,
    drying: float,
    change: Callable[[str, str], Iterable[Waypoints]] | None,
) -> Iterator[str]:
    numbers, painted = plan.layer.tolist(), 0
    if change is not None and numbers:
        yield from _motions(change("", plan.layers[numbers[0]].brush), language)
    elif len(plan.brushes) > 1 and numbers:
        yield _wait(f"take the {plan.layers[numbers[0]].brush} brush", language)
    for action in actions:
        if isinstance(action.done, Dipped) and pauses:
            yield _dip(plan.wells(plan.layers[numbers[painted]]), action.done, language)
            continue
        yield from _motions(action.motions, language)
        painted += isinstance(action.done, StrokePainted)
        if (
            0 < painted < len(plan)
            and numbers[painted - 1] != numbers[painted]
            and isinstance(action.done, StrokePainted)
        ):
            before, after = (plan.layers[numbers[index]].brush for index in (painted - 1, painted))
            changed = change is not None and before != after
            if change is not None and changed:
                yield from _motions(change(before, after), language)
            if todo := _between(plan, painted, drying, changed):
                yield _wait(todo, language)


def _between(plan: Plan, done: int, drying: float, changed: bool) -> str:
    """What a person does before the next layer begins, `done` strokes being painted, "" for nothing.

    drying: seconds; changed: whether the machine has cleaned the brush and taken the next one by itself.
    """
    numbers = plan.layer
    before, after = plan.layers[int(numbers[done - 1])], plan.layers[int(numbers[done])]
    todo = [] if changed else ["clean the brush"]
    if after.brush != before.brush and not changed:
        todo.append(f"take the {after.brush} brush")
    if after.paints != before.paints:
        todo.append(f"fill the wells with the paints of layer {int(numbers[done]) + 1}")
    minutes = f"{drying / 60:g} minute{'' if drying == 60 else 's'}"
    dry = f"{', and ' if todo else ''}let this layer dry for {minutes} before the next one" if drying else ""
    return f"{', '.join(todo)}{dry}"


def _motions(motions: Iterable[Waypoints], language: Gcode) -> Iterator[str]:
    return (line for motion in motions for line in _motion(motion, language))


def _motion(motion: Waypoints, language: Gcode) -> Iterator[str]:
    yield f"; {motion.label}"
    yield from (line for _, line in language.lines(motion))


def _dip(wells: Palette, dip: Dipped, language: Gcode) -> str:
    clean = "clean the brush, then " if dip.cleaned else ""
    return _wait(f"{clean}dip into paint {dip.paint + 1} {to_hex(wells.color[dip.paint])}", language)


def _wait(text: str, language: Gcode) -> str:
    # Marlin shows the words behind M0 on its display; GRBL takes them for a comment in brackets only.
    return f"M0 {text}" if language.flavour == "marlin" else f"M0 ({text})"
