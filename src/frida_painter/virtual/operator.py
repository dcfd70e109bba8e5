"""The studio's operator: fills the wells, lays paper and the colour checker, and never has to be asked twice."""

from collections.abc import Callable, Mapping

import numpy as np
from numpy.typing import NDArray

from frida_painter.errors import ConfigError
from frida_painter.palette import Palette
from frida_painter.virtual.bristles import Tuft
from frida_painter.virtual.canvas import Canvas
from frida_painter.virtual.checker import Checker
from frida_painter.virtual.paint import absorption_and_scattering, to_linear
from frida_painter.virtual.simulation_log import Note, unnoted
from frida_painter.virtual.table import Table


class StudioOperator:
    """Implements hardware.easel.Operator over a table.

    tufts: of its brushes, by the names that they are asked for by; note: told of everything that is done.
    """

    def __init__(
        self,
        table: Table,
        checker: Checker,
        fresh_canvas: Callable[[], Canvas],
        wait: Callable[[float], None],
        tufts: Mapping[str, Tuft],
    ) -> None:
        self.checker = checker
        self.note: Note = unnoted
        self._table, self._fresh_canvas, self._wait, self._tufts = table, fresh_canvas, wait, tufts

    def fill_wells(self, palette: Palette) -> None:
        """Empties all wells and fills well i with paint i."""
        self.pour(palette.color.detach().cpu().double().numpy())

    def pour(self, color: NDArray[np.float64]) -> None:
        """Fills well i with paint of colour i, sRGB [k, 3]."""
        self._table.paints = tuple(absorption_and_scattering(color))
        self.note({"did": "fill", "color": color.tolist()})

    def tone(self, ground: tuple[float, float, float]) -> None:
        """Tones the canvas in that colour (sRGB) and lets it dry."""
        self._table.canvas.tone(to_linear(np.array(ground)))
        self.note({"did": "tone", "ground": list(ground)})

    def change_brush(self, brush: str) -> None:
        """Puts the brush of that name into the holder, where it is not there already. Raises ConfigError."""
        if brush not in self._tufts:
            raise ConfigError(f"The studio was opened with {', '.join(self._tufts)}, not with the brush {brush!r}.")
        if self._table.tuft is not self._tufts[brush]:
            self._table.tuft = self._tufts[brush]
            self.note({"did": "brush", "name": brush})

    def let_dry(self, seconds: float) -> None:
        """Lets time pass."""
        self._wait(seconds)

    def lay_paper(self) -> bool:
        """Puts a fresh canvas where the first one lay."""
        self._table.lay(self._fresh_canvas())
        self.note({"did": "paper"})
        return True

    def place_checker(self, center: tuple[float, float], turn: float, width: float | None) -> None:
        """Lays the colour checker there; from now on always there. Millimetres on the canvas, radians."""
        self.checker = self.checker.laid(center, turn, width)
        self.lay_checker()

    def lay_checker(self) -> bool:
        """Lays the colour checker on the canvas."""
        self._put_checker(self.checker)
        return True

    def take_checker_away(self) -> bool:
        """Takes it off again."""
        self._put_checker(None)
        return True

    def _put_checker(self, lying: Checker | None) -> None:
        self._table.checker = lying
        card = self.checker
        self.note(
            {
                "did": "checker",
                "lies": lying is not None,
                "center": list(card.center),
                "turn": card.turn,
                "width": card.width,
            }
        )
