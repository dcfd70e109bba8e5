"""Experiment: calibration with faults of paint, camera, light, paper, dots and checker.

The virtual studio paints every case twice, undisturbed and with a fault. A fault is survived, detected (the bad
parts are left out), or refused with a sentence. A wrong model or calibration without a message must not happen.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from textwrap import wrap
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from torch import Tensor

from frida_painter.brush.kinds import brush_kind
from frida_painter.brush.library import Flaw, StrokeLibrary, clean, judge
from frida_painter.canvas_size import CanvasSize
from frida_painter.easel.dialogue import Answer, Question, lead
from frida_painter.easel.virtual_easel import PAPER
from frida_painter.errors import FridaError
from frida_painter.hardware.faults import Bump, Faults, LightChange, LostFocus, PlacementError
from frida_painter.lab import ExperimentScale
from frida_painter.lab.paintings import EXACT, connect_studio, virtual_library
from frida_painter.lab.stroke_models import DEFAULT, errors, learn
from frida_painter.lab.trials import Notify, Outcome, Progress, ResultTable, Row, silent, within
from frida_painter.procedures.color import color
from frida_painter.procedures.robot import robot
from frida_painter.procedures.strokes import StrokesFinding, contact_sheet, strokes, unfinished_folder
from frida_painter.sheet import INK, LINE, SOFT, Grid, Sheet, font
from frida_painter.sheet import PAPER as WHITE
from frida_painter.virtual.studio import VirtualStudio, open_studio

Found = TypeVar("Found")

NAME = "robustness"
REFUSED, DETECTED, SURVIVED = "refused", "detected", "survived"
_CANVAS = CanvasSize(0.3556, 0.2794)
_MODEL_ERROR, _PLACEMENT, _COLORS = "error of the stroke model", "placement, mm", "colours, CIEDE2000"
# Factors of error that still count as equal; trainings differ that much between seeds.
_TOLERATED = {_MODEL_ERROR: 1.10, _PLACEMENT: 1.5, _COLORS: 1.25}
# The picture, pixels.
_WIDTH, _MARGIN, _TOP = 1500, 44, 128
_ROW, _TEXT_WIDTH = 120, 108
_LEFT = 900  # left edge of the bars
_LONGEST = 330
_CHIP, _CHIP_HEIGHT = 118, 28
_CHIPS = {SURVIVED: (0, 138, 100), DETECTED: (0, 114, 178), REFUSED: (171, 92, 20)}
_WRONG = (192, 57, 28)
_BARS = ((184, 179, 170), (0, 114, 178), (213, 94, 0))
_NAMES = ("undisturbed", "disturbed", "as if nothing had been told")
_Color = tuple[int, int, int]

FULL = ExperimentScale(strokes=100, held_out=40)
QUICK = ExperimentScale(strokes=12, held_out=6, quick=True)


@dataclass(frozen=True)
class Case:
    """Case: a fault and its effect. None stands for a value that was not measured.

    what: the fault in words
    outcome: "survived", "detected" or "refused"
    figure: name of the measured value
    undisturbed, disturbed: value without and with the fault
    untold: value with the fault if nothing were detected or done about it
    said: message to the person
    harmless: True unless the result is wrong without a message
    """

    what: str
    outcome: str
    figure: str
    undisturbed: float | None
    disturbed: float | None
    untold: float | None
    said: str
    harmless: bool


def run(*, brush: str = "broad", seed: int = 0, scale: ExperimentScale = FULL, notify: Notify = silent) -> Outcome:
    """Runs all cases with a brush of the project. Raises ConfigError if there is no such brush."""
    libraries = _Libraries(brush, seed, scale)
    undisturbed = libraries.prepare(within(notify, 0.0, 0.2))
    cases: list[Case] = []
    spoilt: StrokeLibrary | None = None
    dirty = libraries.faults()
    for number, (what, faults) in enumerate(dirty.items()):
        notify(Progress(0.2 + 0.7 * number / len(dirty), what))
        case, library = libraries.case(what, faults, undisturbed)
        cases.append(case)
        spoilt = library if spoilt is None else spoilt
    notify(Progress(0.9, "painting dots"))
    cases.append(_dots(brush, seed))
    notify(Progress(0.95, "looking at a colour checker"))
    cases.append(_checker(brush, seed))
    wrong = [case.what for case in cases if not case.harmless]
    pictures = {NAME: robustness_sheet(f"Reality is dirtier: the {brush} brush", cases)}
    if spoilt is not None:
        pictures["contact-sheet"] = contact_sheet(spoilt, f"Strokes of the {brush} brush, some without paint")
    return Outcome(
        NAME,
        "Reality is dirtier: what goes wrong, and what becomes of it",
        {"brush": brush, "seed": seed, "strokes": scale.strokes, "held_out": scale.held_out, "model": DEFAULT},
        (ResultTable("What went wrong, and what became of it", tuple(_row(case) for case in cases)),),
        (
            f"Of {len(cases)} cases {_count(cases, SURVIVED)} are survived, {_count(cases, DETECTED)} detected and "
            f"{_count(cases, REFUSED)} refused; "
            + (f"silently wrong: {', '.join(wrong)}." if wrong else "none leaves a silently wrong model."),
        ),
        pictures,
    )


def _row(case: Case) -> Row:
    return {
        "what goes wrong": case.what,
        "outcome": case.outcome,
        "figure": case.figure,
        "undisturbed": _round_or_none(case.undisturbed),
        "disturbed": _round_or_none(case.disturbed),
        "as if nothing had been told": _round_or_none(case.untold),
        "said": case.said,
    }


def _round_or_none(value: float | None) -> float | None:
    return None if value is None else float(f"{value:.4g}")


def _count(cases: list[Case], outcome: str) -> int:
    return sum(case.outcome == outcome for case in cases)


class _Libraries:
    """Stroke libraries painted with faults, and models that learn from them."""

    def __init__(self, brush: str, seed: int, scale: ExperimentScale) -> None:
        self.kind = brush_kind(brush)
        self.seed, self.scale = seed, scale

    def prepare(self, notify: Notify) -> float:
        """Returns the error of a model from an undisturbed library, on other clean strokes."""
        brush, strokes = self.kind.name, self.scale.strokes
        self.test = virtual_library(brush, self.scale.held_out, self.seed + 1, within(notify, 0.0, 0.3))
        return self._error(virtual_library(brush, strokes, self.seed, within(notify, 0.3, 1.0)))

    def faults(self) -> dict[str, Faults]:
        """Returns the faults, by name."""
        number = np.arange(self.scale.strokes)
        tenth = [int(stroke) for stroke in number[number % 10 == 5]]
        lamps = [(0.7, 0.7, 0.7), (0.95, 0.85, 0.65), (0.85, 0.9, 0.95), (0.55, 0.55, 0.55), (1.0, 1.0, 1.0)]
        leans = [(0.0, 0.0), (0.1, 0.0), (-0.1, 0.15), (0.0, 0.0), (0.0, -0.2)]
        every = max(1, self.scale.strokes // len(lamps))
        return {
            # Every tenth stroke has no paint on the brush. Also, the well is empty for seven strokes in a row,
            # repeatedly.
            "20 % of the strokes run out of paint": Faults(
                dropped_touches=frozenset(number[number % 10 == 9].tolist()),
                dry_dips=frozenset(number[number % 30 >= 23].tolist()),
            ),
            "the light changes between photographs": Faults(
                light_changes=tuple(
                    LightChange(every // 2 + every * k, *change)
                    for k, change in enumerate(zip(lamps, leans, strict=True))
                )
            ),
            "the paper moves by 3 mm between two photographs, at every tenth stroke": Faults(
                bumps=tuple(Bump(stroke, (0.003 * (-1) ** k, 0.0)) for k, stroke in enumerate(tenth))
            ),
            "the camera loses focus for a moment, at every tenth stroke": Faults(
                lost_focus=tuple(LostFocus(stroke, stroke) for stroke in tenth)
            ),
            "the camera loses focus for good": Faults(lost_focus=(LostFocus(self.scale.strokes // 2),)),
        }

    def case(self, what: str, faults: Faults, undisturbed: float) -> tuple[Case, StrokeLibrary | None]:
        """Returns the case of a library painted with faults, and the library; None instead of a refused library."""
        studio = _studio(PAPER, self.kind.name, self.seed, EXACT, faults)
        with TemporaryDirectory() as folder:
            out = Path(folder) / "library.npz"
            painting = strokes(studio.easel, self.kind, out, count=self.scale.strokes, seed=self.seed)
            found = _attempt(lambda: lead(painting, _proposal))
            kept = len(list(unfinished_folder(out).glob("stroke-*")))
        if not isinstance(found, StrokesFinding):
            said = f"{found} ({kept} strokes are kept.)"
            return Case(what, REFUSED, _MODEL_ERROR, undisturbed, None, None, said, True), None
        library = found.library
        flawed = bool((judge(library) != Flaw.NONE).any())
        with_flags = self._error(library)
        untold = replace(library, flaws=np.zeros(len(library), np.uint8))
        without = self._error(untold) if flawed else None
        said = found.sentence.partition(":")[0]
        outcome = DETECTED if flawed else SURVIVED
        return _case(what, outcome, _MODEL_ERROR, undisturbed, with_flags, without, said), library

    def _error(self, library: StrokeLibrary) -> float:
        """Returns the error on the test strokes of a model that learned from a library's clean strokes."""
        predict = learn(DEFAULT, clean(library), seed=self.seed, quick=self.scale.quick)
        return float(errors(predict, clean(self.test)).mean())


def _dots(brush: str, seed: int) -> Case:
    """Returns the case of two missing dots out of sixteen."""
    error = PlacementError((0.0032, -0.0024), math.radians(2))
    remaining: list[float] = []
    said = ""
    for missing in (frozenset[int](), frozenset({4, 11})):
        studio = _studio(_CANVAS, brush, seed, error, Faults(dropped_touches=missing))
        found = _attempt(lambda studio=studio: lead(robot(studio.easel), _proposal))  # type: ignore[misc]
        if isinstance(found, FridaError):
            return _refused("two of the 16 dots are missing", _PLACEMENT, remaining, found)
        said = found.sentence
        remaining.append(1000 * _measure_miss(studio, found.enter(studio.easel.calibration).place))
    untold = 1000 * _measure_miss(studio, lambda position: position)
    return _case("two of the 16 dots are missing", SURVIVED, _PLACEMENT, remaining[0], remaining[1], untold, said)


def _measure_miss(studio: VirtualStudio, place: Callable[[NDArray[np.float64]], NDArray[np.float64]]) -> float:
    """Returns the robot's placement error, averaged over the canvas, metres."""
    size = studio.easel.canvas
    meant = np.stack(np.meshgrid(np.linspace(0, size.width, 21), np.linspace(0, size.height, 17)), -1).reshape(-1, 2)
    landed = studio.placement_error.displace(place(meant), np.array([size.width, size.height]) / 2)
    return float(np.linalg.norm(landed - meant, axis=1).mean())


def _checker(brush: str, seed: int) -> Case:
    """Returns the case of a colour checker that lies upside down."""
    what, said = "the checker is rotated by 180 degrees", ""
    after: list[float] = []
    before: float | None = None
    for turn in (0.0, math.pi):
        studio = _studio(_CANVAS, brush, seed, EXACT, Faults())
        studio.lay_checker((_CANVAS.width / 2, _CANVAS.height / 2), turn)
        found = _attempt(lambda studio=studio: lead(color(studio.easel), _proposal))  # type: ignore[misc]
        if isinstance(found, FridaError):
            return _refused(what, _COLORS, after, found)
        after.append(float(found.held_out.mean()))
        before, said = float(found.photographed.mean()), found.sentence
    return _case(what, SURVIVED, _COLORS, after[0], after[1], before, said)


def _case(
    what: str, outcome: str, figure: str, undisturbed: float, disturbed: float, untold: float | None, said: str
) -> Case:
    harmless = disturbed <= _TOLERATED[figure] * undisturbed
    return Case(what, outcome, figure, undisturbed, disturbed, untold, said, harmless)


def _refused(what: str, figure: str, measured: Sequence[float], refusal: FridaError) -> Case:
    """Returns the case of a refused calibration, and says if it was refused with the fault or already without it.

    measured: value without the fault, if that calibration succeeded
    """
    if measured:
        return Case(what, REFUSED, figure, measured[0], None, None, str(refusal), True)
    said = f"Refused even without the fault, so nothing is known of it: {refusal}"
    return Case(what, REFUSED, figure, None, None, None, said, False)


def _studio(canvas: CanvasSize, brush: str, seed: int, error: PlacementError, faults: Faults) -> VirtualStudio:
    return connect_studio(open_studio(canvas, brush, seed=seed, placement_error=error, faults=faults))


def _attempt(calibrate: Callable[[], Found]) -> Found | FridaError:
    try:
        return calibrate()
    except FridaError as refusal:
        return refusal


def _proposal(question: Question) -> Answer:
    """Returns the procedure's own proposal; False if it has none."""
    return question.proposal if question.proposal is not None else False


def robustness_sheet(title: str, cases: Sequence[Case]) -> Tensor:
    """Returns all cases in rows, sRGB [3, H, 1500] in [0, 1]; bars of the same figure have the same scale."""
    rows = Grid(_MARGIN, _TOP, 1, _WIDTH - 2 * _MARGIN, _ROW)
    sheet = Sheet(_WIDTH, rows.bottom(len(cases)) + _MARGIN // 2)
    sheet.text((_MARGIN, 34), title, 32, INK)
    _legend(sheet)
    for case, (left, top) in zip(cases, rows.corners(len(cases)), strict=True):
        sheet.draw.line((left, top - 14, rows.right, top - 14), fill=LINE, width=1)
        _words(sheet, case, top)
        alike = [value for other in cases if other.figure == case.figure for value in _values(other) if value]
        _bars(sheet, case, top, max(alike, default=1.0))
    return sheet.tensor()


def _values(case: Case) -> tuple[float | None, ...]:
    return case.undisturbed, case.disturbed, case.untold


def _legend(sheet: Sheet) -> None:
    x = _LEFT
    for name, fill in zip(_NAMES, _BARS, strict=True):
        sheet.draw.rectangle((x, 92, x + 14, 104), fill=fill)
        sheet.text((x + 22, 98), name, 15, SOFT, "lm")
        x += 44 + round(font(15).getlength(name))


def _chip(color: _Color) -> Image.Image:
    """Returns a rounded field for a word, supersampled for smooth corners."""
    large = Sheet(4 * _CHIP, 4 * _CHIP_HEIGHT)
    large.draw.rounded_rectangle((0, 0, *large.image.size), 2 * _CHIP_HEIGHT, fill=color)
    return large.shrink(_CHIP, _CHIP_HEIGHT)


def _words(sheet: Sheet, case: Case, top: int) -> None:
    color: _Color = _CHIPS[case.outcome] if case.harmless else _WRONG
    sheet.paste(_chip(color), (_MARGIN, top))
    word = case.outcome if case.harmless else "wrong"
    sheet.text((_MARGIN + _CHIP / 2, top + 14), word, 16, WHITE, "mm")
    sheet.text((_MARGIN + _CHIP + 18, top + 14), case.what, 19, INK, "lm")
    lines = wrap(case.said, _TEXT_WIDTH)
    if len(lines) > 3:
        lines = [*lines[:2], lines[2][: _TEXT_WIDTH - 2] + " …"]
    sheet.draw.multiline_text((_MARGIN, top + 40), "\n".join(lines), fill=SOFT, font=font(15), spacing=5)


def _bars(sheet: Sheet, case: Case, top: int, longest: float) -> None:
    sheet.text((_LEFT, top + 8), case.figure, 15, SOFT, "lm")
    y = top + 24
    for value, fill in zip(_values(case), _BARS, strict=True):
        if value is None:
            continue
        length = max(2, round(_LONGEST * value / longest))
        sheet.draw.rectangle((_LEFT, y, _LEFT + length, y + 16), fill=fill)
        sheet.text((_LEFT + length + 10, y + 8), f"{value:.3g}", 15, INK, "lm")
        y += 22
    if case.disturbed is None:
        sheet.text((_LEFT, y + 8), "refused: there is no model to be wrong", 15, SOFT, "lm")
