"""The wells before painting: a person sees what to mix, says when it is done, and may tell what it has become."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from frida_painter.errors import FridaError, Interrupted, PlanError

if TYPE_CHECKING:
    from frida_painter.palette import Palette

PaletteOption = Annotated[
    Path | None,
    typer.Option(
        "--palette",
        metavar="FILE",
        help="The paints that you really mixed: a palette of GIMP (.gpl), Adobe (.ase, .aco), Krita, Procreate or "
        'Paint.NET, colours like #f2e9dc one a line, CSV, JSON like {"paints": ["#f2e9dc", ...]}, a picture of them, '
        "or a photograph of a strip with bare paper and one swatch of each paint.",
    ),
]
AskOption = Annotated[
    bool,
    typer.Option(
        "--ask", help="Wait until you have filled the wells. You can then enter the paints that you really mixed."
    ),
]

FilledOption = Annotated[
    bool,
    typer.Option("--yes", "-y", help="Do not ask whether the wells of a real robot are filled. For scripts."),
]


@dataclass
class Wells:
    """Asked when the paints of the next layers are settled; answers with what was mixed, None for what was wanted.

    given: known from the beginning; ask: shows a prompt and returns what was typed, None where nobody
    is to be asked; folder: where the palette and the mixing sheet lie; poured: whether somebody has said
    by then that the wells are filled.
    """

    given: "Palette | None"
    ask: Callable[[str], str] | None
    folder: Path
    poured: bool = False

    def filled(self, wanted: "Palette") -> "Palette | None":
        """Returns when the wells are filled. Raises Interrupted where the person leaves."""
        from frida_painter.perception.swatches import read_palette

        if self.ask is None:
            return self.given
        prompt = "Press Enter if they are just these paints, or type the file that tells what you mixed: "
        if not self.poured:
            sheet = self._sheet(wanted)
            prompt = (
                f"Fill {len(wanted)} wells as on {self.folder / sheet} ({sheet.replace('palette', 'mixing')} tells how "
                "to mix them). Press Enter when they are filled, or type the file that tells what you mixed: "
            )
        while True:
            try:
                line = self.ask(prompt).strip()
            except (EOFError, KeyboardInterrupt) as end:
                raise Interrupted("Nobody said that the wells are filled, and nothing was painted.") from end
            if not line:
                return self.given
            try:
                return read_palette(Path(line), len(wanted))
            except FridaError as error:
                prompt = f"{error} Enter, or another file: "

    def _sheet(self, wanted: "Palette") -> str:
        """The name of the sheet that shows these paints; where the plan does not tell, that of the first layer."""
        import torch

        from frida_painter.plan import Plan
        from frida_painter.report.palette_sheet import sheet_file

        try:
            fillings = Plan.load(self.folder).by_wells()
        except PlanError:
            fillings = []
        layers = (layer for layer, part in fillings if torch.equal(part.palette.color, wanted.color))
        return sheet_file("palette.png", next(layers, 1))
