"""The picture of the robustness table: each case with what became of it, and its figure beside the undisturbed one."""

from collections.abc import Sequence
from dataclasses import dataclass
from textwrap import wrap

from PIL import Image
from torch import Tensor

from frida_painter.sheet import INK, LINE, PAPER, SOFT, Sheet, font

_WIDTH, _MARGIN, _TOP = 1500, 44, 128
_ROW, _TEXT_WIDTH = 120, 108
_LEFT = 900  # where the bars begin
_LONGEST = 330
_CHIP, _CHIP_HEIGHT = 118, 28
_COLORS = {"survived": (0, 138, 100), "detected": (0, 114, 178), "refused": (171, 92, 20)}
_WRONG = (192, 57, 28)
_BARS = ((184, 179, 170), (0, 114, 178), (213, 94, 0))
_NAMES = ("undisturbed", "disturbed", "as if nothing had been told")
_Color = tuple[int, int, int]


@dataclass(frozen=True)
class Case:
    """Something that goes wrong.

    what: in words; outcome: "survived", "detected" or "refused"; figure: what is measured; undisturbed,
    disturbed: without and with it; untold: with it, had nobody been told and nothing been done about
    it; said: what the person is told; harmless: whether nothing is silently wrong. None: not measured.
    """

    what: str
    outcome: str
    figure: str
    undisturbed: float | None
    disturbed: float | None
    untold: float | None
    said: str
    harmless: bool


def robustness_sheet(title: str, cases: Sequence[Case]) -> Tensor:
    """All cases below one another, sRGB [3, H, 1500] in [0, 1]; bars of one kind of figure have one scale."""
    sheet = Sheet(_WIDTH, _TOP + _ROW * len(cases) + _MARGIN // 2)
    sheet.text((_MARGIN, 34), title, 32, INK)
    _legend(sheet)
    for row, case in enumerate(cases):
        top = _TOP + row * _ROW
        sheet.draw.line((_MARGIN, top - 14, _WIDTH - _MARGIN, top - 14), fill=LINE, width=1)
        _words(sheet, case, top)
        alike = [value for other in cases if other.figure == case.figure for value in _values(other) if value]
        _bars(sheet, case, top, max(alike, default=1.0))
    return sheet.tensor()


def _values(case: Case) -> tuple[float | None, ...]:
    return case.undisturbed, case.disturbed, case.untold


def _legend(sheet: Sheet) -> None:
    x = _LEFT
    for name, color in zip(_NAMES, _BARS, strict=True):
        sheet.draw.rectangle((x, 92, x + 14, 104), fill=color)
        sheet.text((x + 22, 98), name, 15, SOFT, "lm")
        x += 44 + round(font(15).getlength(name))


def _chip(color: _Color) -> Image.Image:
    """A rounded field for a word, drawn larger and then made smaller, which smooths its corners."""
    large = Sheet(4 * _CHIP, 4 * _CHIP_HEIGHT)
    large.draw.rounded_rectangle((0, 0, *large.image.size), 2 * _CHIP_HEIGHT, fill=color)
    return large.image.resize((_CHIP, _CHIP_HEIGHT), Image.Resampling.LANCZOS)


def _words(sheet: Sheet, case: Case, top: int) -> None:
    color: _Color = _COLORS[case.outcome] if case.harmless else _WRONG
    sheet.paste(_chip(color), (_MARGIN, top))
    word = case.outcome if case.harmless else "wrong"
    sheet.text((_MARGIN + _CHIP / 2, top + 14), word, 16, PAPER, "mm")
    sheet.text((_MARGIN + _CHIP + 18, top + 14), case.what, 19, INK, "lm")
    lines = wrap(case.said, _TEXT_WIDTH)
    if len(lines) > 3:
        lines = [*lines[:2], lines[2][: _TEXT_WIDTH - 2] + " …"]
    sheet.draw.multiline_text((_MARGIN, top + 40), "\n".join(lines), fill=SOFT, font=font(15), spacing=5)


def _bars(sheet: Sheet, case: Case, top: int, longest: float) -> None:
    sheet.text((_LEFT, top + 8), case.figure, 15, SOFT, "lm")
    y = top + 24
    for value, color in zip(_values(case), _BARS, strict=True):
        if value is None:
            continue
        length = max(2, round(_LONGEST * value / longest))
        sheet.draw.rectangle((_LEFT, y, _LEFT + length, y + 16), fill=color)
        sheet.text((_LEFT + length + 10, y + 8), f"{value:.3g}", 15, INK, "lm")
        y += 22
    if case.disturbed is None:
        sheet.text((_LEFT, y + 8), "refused: there is no model to be wrong", 15, SOFT, "lm")
