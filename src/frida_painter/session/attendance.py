"""Who prepares what is needed at a real easel: a person, who is asked."""

from collections.abc import Callable

import torch

from frida_painter.errors import Interrupted
from frida_painter.palette import Palette, to_hex
from frida_painter.session.procedures.dialogue import Answer, Confirm, Question


class PersonAttending:
    """Implements hardware.easel.Attendant by questions; `answer` leads the dialogue with the person."""

    def __init__(self, answer: Callable[[Question], Answer]) -> None:
        self._answer = answer

    def fill_wells(self, palette: Palette) -> None:
        """Returns when the person says that the wells are filled. Raises Interrupted where they will not be."""
        paints = ", ".join(f"{number} {to_hex(color)}" for number, color in enumerate(palette.color, start=1))
        question = f"Mix these paints and fill the wells, the first with paint 1: {paints}. Are all of them filled?"
        if self._answer(Confirm(question, _swatches(palette))) is not True:
            raise Interrupted("The wells were not filled, and nothing was painted; the plan is kept.")

    def lay_paper(self) -> bool:
        """False: procedures ask the person themselves."""
        return False

    def lay_checker(self) -> bool:
        """False: procedures ask the person themselves."""
        return False

    def take_checker_away(self) -> bool:
        """False: procedures ask the person themselves."""
        return False


class NobodyAttending:
    """Implements hardware.easel.Attendant in a process that nobody talks with: the one that talks has the person."""

    def fill_wells(self, palette: Palette) -> None:
        """Leaves it to the other process."""

    def lay_paper(self) -> bool:
        """False: a person is to be asked."""
        return False

    def lay_checker(self) -> bool:
        """False: a person is to be asked."""
        return False

    def take_checker_away(self) -> bool:
        """False: a person is to be asked."""
        return False


def _swatches(palette: Palette) -> torch.Tensor:
    """The paints beside each other, from the first well on, [3, 120, 120 k]."""
    return palette.color.T[:, None, :].repeat_interleave(120, 2).expand(3, 120, -1).contiguous()
