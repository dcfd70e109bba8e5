"""Operators of real easels: a person who is asked, and a stand-in for a process that cannot ask."""

from collections.abc import Callable, Sequence

import torch
from torch import Tensor

from frida_painter.easel.dialogue import Answer, Confirm, Question
from frida_painter.errors import Interrupted
from frida_painter.hardware.easel import Operator
from frida_painter.mixing import Finish
from frida_painter.mixing.paint import usual_paints
from frida_painter.mixing.recipe import PaintSet
from frida_painter.strokes.palette import Palette, to_hex
from frida_painter.system.sheet import CREAM, INK, Grid, Sheet, to_bytes

_SWATCH = 150  # pixels


class AbsentOperator(Operator):
    """Operator of a process without a dialogue: the painting process asks the person, and paint dries without help."""


class PersonAsOperator(AbsentOperator):
    """Operator that asks a person; about paper and checker, procedures ask the person themselves.

    answer: shows a question to the person and returns the answer
    """

    def __init__(self, answer: Callable[[Question], Answer]) -> None:
        self._answer = answer
        self._filled = False

    def fill_wells(self, palette: Palette) -> None:
        """Returns when the person says that the wells are filled. Raises Interrupted if the person declines."""
        first, self._filled = ("Empty and wash the wells. " if self._filled else ""), True
        paints = ", ".join(f"{number} {to_hex(color)}" for number, color in enumerate(palette.color, start=1))
        if self._answer(Confirm(first + self._asking_for(paints), _swatches(palette), moves=True)) is not True:
            raise Interrupted("The paints were not there, and nothing was painted; the plan is kept.")

    def tone(self, ground: tuple[float, float, float]) -> None:
        """Returns when the person says that the canvas is toned and dry. Raises Interrupted if the person declines."""
        question = (
            f"Tone the whole canvas evenly in {ground_recipe(ground)}. Let it dry, and put it back exactly where it "
            "was. Is it there?"
        )
        if self._answer(Confirm(question, _even(ground), moves=True)) is not True:
            raise Interrupted("The canvas was not toned, and nothing was painted; resume the painting when it is.")

    def change_brush(self, brush: str) -> None:
        """Returns when the person says that the brush is in the holder. Raises Interrupted if the person declines."""
        if self._answer(Confirm(f"{self._changing_to(brush)} Is it done?", moves=True)) is not True:
            raise Interrupted(
                f"The {brush} brush was not there, and nothing was painted with another; resume when it is."
            )

    def _changing_to(self, brush: str) -> str:
        return (
            f"The next strokes are painted with the {brush} brush: put it, clean, into the robot's holder, as deep as "
            "it was when it was calibrated."
        )

    def _asking_for(self, paints: str) -> str:
        return f"Mix these paints and fill the wells, the first with paint 1: {paints}. Are all of them filled?"


def brush_in_hand(brushes: Sequence[str], answer: Callable[[Question], Answer] | None) -> str:
    """Asks a person for the brush in the hand of a robot that broke off during a change of brushes.

    Returns the brush's name, or "" for an empty hand.
    Raises Interrupted if nobody answers, or if it is none of `brushes` and the hand is not empty.
    """
    broke_off = "The painting broke off while the robot changed its brush. "
    if answer is not None:
        first = f"{broke_off}Look at it, and free the hand by hand if it is half in a fork. "
        for name in brushes:
            if answer(Confirm(f"{first}Is the {name} brush in the robot's hand?", proposal=False)) is True:
                return name
            first = ""
        if answer(Confirm("Is the hand empty, and does every brush stand in its fork?", proposal=False)) is True:
            return ""
    raise Interrupted(
        f"{broke_off}Nobody said which brush is in its hand, and nothing was moved. Put all brushes into their forks, "
        "then resume the painting and answer."
    )


def ground_recipe(ground: tuple[float, float, float]) -> str:
    """Returns a ground's colour with its mixture of six usual paints: "#c8a878 (6 titanium white + 1 hansa yellow)"."""
    (recipe,) = PaintSet(usual_paints(), Finish.matte, darkest=None).mix(torch.tensor([ground]))
    return f"{to_hex(recipe.target)} ({recipe.words})"


def _even(color: tuple[float, float, float]) -> Tensor:
    """Returns a swatch [3, 150, 150]."""
    return torch.tensor(color)[:, None, None].expand(3, _SWATCH, _SWATCH).contiguous()


def _swatches(palette: Palette) -> Tensor:
    """Returns the numbered paints in rows of eight, [3, 150 rows, 150 columns]."""
    grid = Grid(0, 0, min(len(palette), 8), _SWATCH, _SWATCH)
    sheet = Sheet(grid.right, grid.bottom(len(palette)), CREAM)
    for index, (color, (x, y)) in enumerate(zip(palette.color, grid.corners(len(palette)), strict=True)):
        sheet.swatch((x, y), _SWATCH, _SWATCH, to_bytes(color))
        sheet.draw.ellipse((x + 12, y + 12, x + 52, y + 52), fill=CREAM)
        sheet.text((x + 32, y + 32), str(index + 1), 24, INK, "mm")
    return sheet.tensor()
