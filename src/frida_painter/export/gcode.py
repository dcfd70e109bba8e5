"""A plan as a G-code file, for machines that take one: strokes in order, and every dip a pause or a motion.

No line has more than 70 characters, the serial buffers of GRBL (127) and Marlin (96) have room for that, and what a
person reads is printable ASCII without the characters that GRBL obeys wherever they stand, in comments too.
"""

import textwrap
import unicodedata
from collections.abc import Callable, Iterable, Iterator

import torch

from frida_painter.hardware.gcode import PREAMBLE, Gcode
from frida_painter.hardware.robot import Waypoints
from frida_painter.palette import Palette, to_hex
from frida_painter.plan import WHITE, Layer, Plan
from frida_painter.session.choreography import Action
from frida_painter.session.events import DRYING, Dipped, StrokePainted

MAX_LINE = 70
"""Characters of a line."""
_SHOWN = 20  # characters of a brush's name on the machine's display
_OBEYED = str.maketrans("!?~;()", "...,::")
"""What GRBL takes out of the stream as a command of its own (!?~), and what begins or ends a comment."""


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
        *_comment(f"frida-painter: {len(plan)} strokes in {len(plan.palette)} paints on {plan.canvas}"),
        *_comment(f"plan {plan.digest[:16]}"),
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
        ground = to_hex(torch.tensor(plan.ground))
        yield from _comment(f"ground {ground}: tone the whole canvas in it, and let it dry, before")


def _paints(plan: Plan) -> Iterator[str]:
    """What is in which well, and with which brush it is painted, layer by layer where they differ."""
    before: Layer | None = None
    for number, layer in enumerate(plan.layers, start=1):
        if len(plan.brushes) > 1:
            yield from _comment(f"layer {number}: {layer.brush} brush")
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
        yield from _wait([_take(plan.layers[numbers[0]])], language)
    for action in actions:
        if isinstance(action.done, Dipped) and pauses:
            yield from _dip(plan.wells(plan.layers[numbers[painted]]), action.done, language)
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
            yield from _wait(_between(plan, painted, drying, changed), language)


def _between(plan: Plan, done: int, drying: float, changed: bool) -> list[str]:
    """What a person does before the next layer begins, `done` strokes being painted, one thing after another.

    drying: seconds; changed: whether the machine has cleaned the brush and taken the next one by itself.
    """
    numbers = plan.layer
    before, after = plan.layers[int(numbers[done - 1])], plan.layers[int(numbers[done])]
    todo = [] if changed else ["clean the brush"]
    if after.brush != before.brush and not changed:
        todo.append(_take(after))
    if after.paints != before.paints:
        todo.append(f"fill the wells with the paints of layer {int(numbers[done]) + 1}")
    if drying:
        minutes = f"{drying / 60:g} minute{'' if drying == 60 else 's'}"
        todo.append(f"let this layer dry for {minutes} before the next one")
    return todo


def _take(layer: Layer) -> str:
    name = _printable(layer.brush)
    return f"take the {name if len(name) <= _SHOWN else f'{name[: _SHOWN - 3]}...'} brush"


def _motions(motions: Iterable[Waypoints], language: Gcode) -> Iterator[str]:
    return (line for motion in motions for line in _motion(motion, language))


def _motion(motion: Waypoints, language: Gcode) -> Iterator[str]:
    yield from _comment(motion.label)
    yield from (line for _, line in language.lines(motion))


def _dip(wells: Palette, dip: Dipped, language: Gcode) -> Iterator[str]:
    clean = "clean the brush, then " if dip.cleaned else ""
    return _wait([f"{clean}dip into paint {dip.paint + 1} {to_hex(wells.color[dip.paint])}"], language)


def _wait(todo: Iterable[str], language: Gcode) -> Iterator[str]:
    """Pauses in which a person does what is to be done: as many things in each as its line has room for."""
    said = ""
    for thing in map(_printable, todo):
        longer = f"{said}, {thing}" if said else thing
        if said and len(_pause(longer, language)) > MAX_LINE:
            yield _pause(said, language)
            longer = thing
        said = longer
    if said:
        yield _pause(said, language)


def _pause(text: str, language: Gcode) -> str:
    # Marlin shows the words behind M0 on its display; GRBL takes them for a comment in brackets only.
    return f"M0 {text}" if language.flavour == "marlin" else f"M0 ({text})"


def _comment(text: str) -> Iterator[str]:
    """The text as comments of as many lines as it takes."""
    return (f"; {line}" for line in textwrap.wrap(_printable(text), MAX_LINE - len("; ")))


def _printable(text: str) -> str:
    """The text in printable ASCII on one line: a machine may obey any other byte."""
    signs = unicodedata.normalize("NFKD", " ".join(text.split())).translate(_OBEYED)
    return "".join(sign if " " <= sign <= "~" else "_" for sign in signs if not unicodedata.combining(sign))
