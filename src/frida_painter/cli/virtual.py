"""How the virtual studio's imperfections are given on the command line."""

from typing import Annotated

import typer

PlacementErrorOption = Annotated[
    str | None,
    typer.Option(
        "--placement-error",
        metavar="X,Y,TURN",
        help="Calibration error of the virtual studio: the offset and rotation between its canvas and where "
        "its robot expects the canvas, like 4mm,2deg or 3mm,-2mm,1.5deg. [dim]about 2mm and 0.4deg, by the seed[/]",
    ),
]
