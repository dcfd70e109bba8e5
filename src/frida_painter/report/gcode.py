"""Plans as G-code files: strokes in order, with a pause or a motion for every dip.

No line has more than 70 characters, which fits the serial buffers of GRBL (127) and Marlin (96). Texts are
printable ASCII, without the characters that GRBL obeys even in comments.
"""

import textwrap
import unicodedata
from collections.abc import Callable, Iterable, Iterator, Sequence

import torch

from frida_painter.hardware.gcode import MAX_LINE, PREAMBLE, Gcode
from frida_painter.hardware.robot import Waypoints
from frida_painter.session.choreography import DRYING, Action
from frida_painter.session.events import Dipped, StrokePainted
from frida_painter.strokes.palette import to_hex
from frida_painter.strokes.plan import WHITE, Layer, Plan

_SHOWN = 20  # characters of a brush's name on the machine's display
_OBEYED = str.maketrans("!?~;()", "...,::")
"""Characters that GRBL takes out of the stream as commands (!?~), and those that begin or end a comment."""


def gcode(
    plan: Plan,
    actions: Iterable[Action],
    language: Gcode,
    *,
    pauses: bool,
    ending: Iterable[Waypoints] = (),
    lettering: Sequence[Waypoints] = (),
    drying: float = DRYING,
    change: Callable[[str, str], Iterable[Waypoints]] | None = None,
) -> str:
    """Returns the plan as a G-code program in millimetres, in the frame of the actions' motions.

    actions: actions that paint the plan
    language: dialect of the machine
    pauses: True to wait at each dip, at travel height, until a person has put paint on the brush or changed the
        pen; False to dip, rinse and wipe by the actions' motions
    ending: motions after the last stroke
    lettering: motions of a pen after those, for which the machine waits (M0)
    drying: seconds for which a layer dries
    change: returns the motions that put back one brush ("" for none) and take another; None if a person changes
        brushes

    A plan of several brushes waits (M0) for the first of them, unless `change` takes it. After each layer but the
    last, the machine waits until a person finds it dry.
    Lines of a person's own (`language.own`) come at the start and the end. If there are lines for dips or for changes
    of the brush, they replace the pauses for these.
    Raises ConfigError if a servo does not reach a height.
    """
    head = (
        *_comment(f"frida-painter: {len(plan)} strokes in {len(plan.palette)} paints on {plan.canvas}"),
        *_comment(f"plan {plan.digest[:16]}"),
        *_paints(plan),
        *PREAMBLE[: 3 if language.flavour == "grbl" else 2],
    )
    todo = list(actions)
    start: Iterable[str] = ()
    if todo:
        x, y, z = todo[0].motions[0].position[0].tolist()
        start = language.rise(z, (x, y))
    body = _body(plan, todo, language, pauses, drying, change)
    first, last = _own(language, "start"), _own(language, "end")
    pen = _wait(["take a pen for title and signature"] if lettering else [], language)
    written = (*_motions(ending, language), *pen, *_motions(lettering, language))
    return "\n".join((*head, *first, *start, *body, *written, *last, "; the end", ""))


def _own(language: Gcode, event: str, **fields: str) -> list[str]:
    """Returns the lines of a person's own at an event; none if there are none."""
    return [] if language.own is None else list(language.own.at(event, **fields))


def _paints(plan: Plan) -> Iterator[str]:
    """Yields comments about a toned ground, and the paint of each well and the brush of each layer that differs."""
    if plan.ground != WHITE:
        ground = to_hex(torch.tensor(plan.ground))
        yield from _comment(f"ground {ground}: tone the whole canvas in it, and let it dry, before")
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
        first = plan.layers[numbers[0]].brush
        yield from _own(language, "change", brush=first) or _wait([_take(first)], language)
    for action in actions:
        if isinstance(action.done, Dipped) and pauses:
            dip, wells = action.done, plan.wells(plan.layers[numbers[painted]])
            clean = "clean the brush, then " if dip.cleaned else ""
            asked = f"{clean}dip into paint {dip.paint + 1} {to_hex(wells.color[dip.paint])}"
            yield from _own(language, "dip", well=str(dip.paint + 1)) or _wait([asked], language)
            continue
        yield from _motions(action.motions, language)
        if not isinstance(action.done, StrokePainted):
            continue
        painted += 1
        if painted < len(plan) and numbers[painted - 1] != numbers[painted]:
            before, after = (plan.layers[numbers[index]].brush for index in (painted - 1, painted))
            changed = change is not None and before != after
            if change is not None and changed:
                yield from _motions(change(before, after), language)
            own = [] if changed or before == after else _own(language, "change", brush=after)
            yield from own
            yield from _wait(_between(plan, painted, drying, changed or bool(own)), language)


def _between(plan: Plan, done: int, drying: float, changed: bool) -> list[str]:
    """Returns a person's tasks before the next layer, in order.

    done: number of strokes already painted
    drying: seconds
    changed: True if the machine has already cleaned the brush and taken the next one
    """
    numbers = plan.layer
    before, after = plan.layers[int(numbers[done - 1])], plan.layers[int(numbers[done])]
    todo = [] if changed else ["clean the brush"]
    if after.brush != before.brush and not changed:
        todo.append(_take(after.brush))
    if after.paints != before.paints:
        todo.append(f"fill the wells with the paints of layer {int(numbers[done]) + 1}")
    if drying:
        minutes = f"{drying / 60:g} minute{'' if drying == 60 else 's'}"
        todo.append(f"let this layer dry for {minutes} before the next one")
    return todo


def _take(brush: str) -> str:
    name = _printable(brush)
    return f"take the {name if len(name) <= _SHOWN else f'{name[: _SHOWN - 3]}...'} brush"


def _motions(motions: Iterable[Waypoints], language: Gcode) -> Iterator[str]:
    for motion in motions:
        yield from _comment(motion.label)
        yield from (line for _, line in language.lines(motion))


def _wait(todo: Iterable[str], language: Gcode) -> Iterator[str]:
    """Yields pauses for a person's tasks, as many tasks in one pause as fit into its line."""
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
    # Marlin shows the text after M0 on its display; GRBL treats it as a comment only in parentheses.
    return f"M0 {text}" if language.flavour == "marlin" else f"M0 ({text})"


def _comment(text: str) -> Iterator[str]:
    """Returns the text as comments, on as many lines as needed."""
    return (f"; {line}" for line in textwrap.wrap(_printable(text), MAX_LINE - len("; ")))


def _printable(text: str) -> str:
    """Returns the text in printable ASCII on one line: a machine may obey any other byte."""
    signs = unicodedata.normalize("NFKD", " ".join(text.split())).translate(_OBEYED)
    return "".join(sign if " " <= sign <= "~" else "_" for sign in signs if not unicodedata.combining(sign))
