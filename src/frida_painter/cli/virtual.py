"""How the virtual studio's imperfections are given on the command line."""

from typing import Annotated

import typer

PlacementErrorOption = Annotated[
    str | None,
    typer.Option(
        "--placement-error",
        metavar="X,Y,TURN",
        help="How far the studio's canvas lies from where its robot believes it to be, like 4mm,2deg or "
        "3mm,-2mm,1.5deg. [dim]about 2mm and 0.4deg, by the seed[/]",
    ),
]
