"""How robots, cameras and workspaces are given on the command line."""

from pathlib import Path
from typing import Annotated

import typer

from frida_painter.cli.numbers import number


def camera_name(text: str) -> str:
    """The name of a camera, the same wherever the program is started: a folder from the root on."""
    kind, _, where = text.partition(":")
    return f"{kind}:{Path(where).expanduser().absolute()}" if kind == "folder" and where else text


RobotOption = Annotated[
    str,
    typer.Option(
        "--robot",
        metavar="NAME",
        help="Who paints: virtual; sawyer-sim, the paper's arm with its weight, its friction and a film of it; human, "
        "xarm:ADDRESS, gcode:PORT, marlin:PORT, axidraw, ros or rosbridge:HOST.",
    ),
]
CameraOption = Annotated[
    str,
    typer.Option(
        "--camera",
        parser=camera_name,
        metavar="NAME",
        help="The camera of a real easel: opencv:0, gphoto or folder:PATH.",
    ),
]
WorkspaceOption = Annotated[
    Path | None,
    typer.Option("--workspace", metavar="FILE", help="Where things stand around a real robot (TOML)."),
]
PaceOption = Annotated[
    float,
    typer.Option(
        "--pace",
        parser=number,
        metavar="X",
        help="How fast the studio's robot moves: 1 as a real one, 0 as fast as can be computed.",
    ),
]
