"""Who prepares what is needed at a real easel: a person, who is asked."""

from collections.abc import Callable, Sequence

import torch
from torch import Tensor

from frida_painter.easel.dialogue import Answer, Confirm, Question
from frida_painter.errors import Interrupted
from frida_painter.mixing.paint import usual_paints
from frida_painter.mixing.recipe import recipes
from frida_painter.palette import Palette, to_hex
from frida_painter.sheet import CREAM, INK, Sheet, to_bytes

_SWATCH = 150  # pixels


class PersonAsOperator:
    """Implements hardware.easel.Operator by questions; `answer` leads the dialogue with the person."""

    def __init__(self, answer: Callable[[Question], Answer]) -> None:
        self._answer = answer
        self._filled = False

    def fill_wells(self, palette: Palette) -> None:
        """Returns when the person says that the wells are filled. Raises Interrupted where they will not be."""
        first, self._filled = ("Empty and wash the wells. " if self._filled else ""), True
        paints = ", ".join(f"{number} {to_hex(color)}" for number, color in enumerate(palette.color, start=1))
        if self._answer(Confirm(first + self._asking_for(paints), _swatches(palette))) is not True:
            raise Interrupted("The paints were not there, and nothing was painted; the plan is kept.")

    def tone(self, ground: tuple[float, float, float]) -> None:
        """Returns when the person says that the canvas is toned and dry. Raises Interrupted where it will not be."""
        question = (
            f"Tone the whole canvas evenly in {ground_recipe(ground)}. Let it dry, and put it back exactly where it "
            "was. Is it there?"
        )
        if self._answer(Confirm(question, _even(ground))) is not True:
            raise Interrupted("The canvas was not toned, and nothing was painted; resume the painting when it is.")

    def change_brush(self, brush: str) -> None:
        """Returns when the person says that the brush is in the holder. Raises Interrupted where it will not be."""
        question = f"{self._changing_to(brush)} Is it done?"
        if self._answer(Confirm(question)) is not True:
            raise Interrupted(
                f"The {brush} brush was not there, and nothing was painted with another; resume when it is."
            )

    def let_dry(self, seconds: float) -> None:
        """Real paint dries by itself."""

    def _changing_to(self, brush: str) -> str:
        return (
            f"The next strokes are painted with the {brush} brush: put it, clean, into the robot's holder, as deep as "
            "it was when it was calibrated."
        )

    def _asking_for(self, paints: str) -> str:
        return f"Mix these paints and fill the wells, the first with paint 1: {paints}. Are all of them filled?"

    def lay_paper(self) -> bool:
        """False: procedures ask the person themselves."""
        return False

    def lay_checker(self) -> bool:
        """False: procedures ask the person themselves."""
        return False

    def take_checker_away(self) -> bool:
        """False: procedures ask the person themselves."""
        return False


class AbsentOperator:
    """Implements hardware.easel.Operator in a process that nobody talks with: the one that talks has the person."""

    def fill_wells(self, palette: Palette) -> None:
        """Leaves it to the other process."""

    def change_brush(self, brush: str) -> None:
        """Leaves it to the other process."""

    def tone(self, ground: tuple[float, float, float]) -> None:
        """Leaves it to the other process."""

    def let_dry(self, seconds: float) -> None:
        """Real paint dries by itself."""

    def lay_paper(self) -> bool:
        """False: a person is to be asked."""
        return False

    def lay_checker(self) -> bool:
        """False: a person is to be asked."""
        return False

    def take_checker_away(self) -> bool:
        """False: a person is to be asked."""
        return False


def brush_in_hand(brushes: Sequence[str], answer: Callable[[Question], Answer] | None) -> str:
    """Which brush a robot holds that broke off while it put one back or took one, "" for none; a person is asked.

    Raises Interrupted where nobody answers, or where it is none of these and the hand is not empty.
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
    """The colour of a ground and how to mix it of six usual paints, "#c8a878 (6 titanium white + 1 hansa yellow)"."""
    (recipe,) = recipes(torch.tensor([ground]), usual_paints())
    return f"{to_hex(recipe.target)} ({recipe.words})"


def _even(color: tuple[float, float, float]) -> Tensor:
    """A swatch [3, 150, 150]."""
    return torch.tensor(color)[:, None, None].expand(3, _SWATCH, _SWATCH).contiguous()


def _swatches(palette: Palette) -> Tensor:
    """The paints with their numbers, from the first on, in rows of eight, [3, 150 rows, 150 columns]."""
    across = min(len(palette), 8)
    sheet = Sheet(_SWATCH * across, _SWATCH * -(-len(palette) // across), CREAM)
    for index, color in enumerate(palette.color):
        row, column = divmod(index, across)
        x, y = _SWATCH * column, _SWATCH * row
        sheet.draw.rectangle((x, y, x + _SWATCH - 1, y + _SWATCH - 1), fill=to_bytes(color))
        sheet.draw.ellipse((x + 12, y + 12, x + 52, y + 52), fill=CREAM)
        sheet.text((x + 32, y + 32), str(index + 1), 24, INK, "mm")
    return sheet.tensor()
