"""How robots, cameras and workspaces are given on the command line."""

from pathlib import Path
from typing import Annotated, Any

import typer
from typer.models import OptionInfo

from frida_painter import registry
from frida_painter.hardware.kinds import CameraKind
from frida_painter.options.numbers import number


class ListingOption(OptionInfo):
    """An option for the name of a part; its help ends with what is registered when the command line is built."""

    def __init__(self, *declared: str, groups: tuple[str, ...], says: str, **more: Any) -> None:
        super().__init__(default=..., param_decls=declared, **more)
        self._groups, self._says = groups, says

    def __getattribute__(self, name: str) -> Any:
        if name == "help":
            known = [part for group in self._groups for part in registry.parts(group)]
            return f"{self._says} {', '.join(known)}."
        return super().__getattribute__(name)


def camera_name(text: str) -> str:
    """The name of a camera, the same wherever the program is started: a path from the root on. Raises PluginError."""
    name, _, where = text.partition(":")
    known = registry.parts(registry.CAMERAS).get(name)
    if known is None or not where or not known.load(CameraKind).is_path:
        return text
    return f"{name}:{Path(where).expanduser().absolute()}"


BrushOption = Annotated[
    str,
    ListingOption("--brush", metavar="NAME", groups=(registry.STROKE_MODELS,), says="The brush. Available:"),
]
RobotOption = Annotated[
    str,
    ListingOption(
        "--robot",
        metavar="NAME",
        groups=(registry.EASELS, registry.ROBOTS),
        says="The robot that paints, like virtual or xarm:192.168.1.10. `doctor` shows how to write each "
        "name. sawyer-sim is a physical simulation of the paper's arm. Available:",
    ),
]
CameraOption = Annotated[
    str,
    ListingOption(
        "--camera",
        parser=camera_name,
        metavar="NAME",
        groups=(registry.CAMERAS,),
        says="The camera of a real easel, like opencv:0 or folder:PATH. `doctor` shows how to write each "
        "name. Available:",
    ),
]
WorkspaceOption = Annotated[
    Path | None,
    typer.Option(
        "--workspace",
        metavar="FILE",
        help="The workspace file of a real robot (TOML): where canvas, wells, water and rag stand.",
    ),
]
PaceOption = Annotated[
    float,
    typer.Option(
        "--pace",
        parser=number,
        metavar="X",
        help="Speed of the virtual robot. 1 is real time, 2 is twice as fast, 0 is as fast as possible.",
    ),
]
