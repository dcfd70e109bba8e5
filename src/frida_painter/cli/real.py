"""Where is painted, as it was given on the command line, and the person beside a real robot."""

from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, Self

import typer
from rich.console import Console

from frida_painter.cli.terminal import Terminal
from frida_painter.errors import ConfigError
from frida_painter.hardware.easel import Easel
from frida_painter.hardware.workcell import WorkcellConfig
from frida_painter.session.by_hand import ByHand
from frida_painter.session.names import HUMAN, SAWYER_SIM
from frida_painter.session.operator import PersonAsOperator
from frida_painter.session.procedures.calibration_status import NEEDED
from frida_painter.session.procedures.dialogue import Answer, Question
from frida_painter.virtual.sawyer.meshes import Meshes

ArmMeshesOption = Annotated[
    Path | None,
    typer.Option(
        "--arm-meshes",
        metavar="FOLDER",
        help="The maker's shapes (OBJ or STL), in which the simulated Sawyer is seen in its film. [dim]our own[/]",
    ),
]


@dataclass(frozen=True)
class Site:
    """Where is painted: the robot and the camera by name, and the workspace file; by default the virtual studio."""

    robot: str = "virtual"
    camera: str = ""
    workspace: Path | None = None

    @property
    def needed(self) -> tuple[str, ...]:
        """The calibrations without which nothing is painted there: a person's hand needs none of its own."""
        return ("canvas",) if self.robot == HUMAN else NEEDED

    def require_somebody(self, *, asked: bool) -> None:
        """Raises ConfigError where nobody is to be `asked` anything, and a person is to paint."""
        if self.robot == HUMAN and not asked:
            raise ConfigError("--yes is for scripts, and a person who paints is asked for every stroke; leave it out.")

    def plain(self) -> dict[str, Any]:
        """As plain values."""
        workspace = None if self.workspace is None else str(self.workspace.resolve())
        return {"robot": self.robot, "camera": self.camera, "workspace": workspace}

    @classmethod
    def take(cls, plain: dict[str, Any]) -> Self:
        """Takes its values out of plain ones. Raises ConfigError where they are of another kind."""
        robot, camera, workspace = plain.pop("robot"), plain.pop("camera"), plain.pop("workspace")
        if not (isinstance(robot, str) and isinstance(camera, str) and isinstance(workspace, str | None)):
            raise ConfigError("robot, camera and workspace are texts, or null for no workspace; bring the file back.")
        return cls(robot, camera, Path(workspace) if workspace else None)

    def canvas(self, given: str | None) -> str | None:
        """The canvas of the workspace file, where no other was given. Raises ConfigError."""
        if self.workspace is None or given is not None:
            return given
        size = WorkcellConfig.load(self.workspace).canvas
        return f"{size.width * 1000:.3f}x{size.height * 1000:.3f}mm"


VIRTUAL = Site()


def require_meshes(folder: Path | None, site: Site) -> None:
    """Raises ConfigError where a folder with an arm's shapes is given that does not fit, or no arm is seen."""
    if folder is None:
        return
    if site.robot != SAWYER_SIM:
        raise ConfigError(f"--arm-meshes is for the film of --robot {SAWYER_SIM}; leave it out.")
    Meshes.in_folder(folder)


def attended(
    easel: Easel,
    site: Site,
    console: Console,
    folder: Path,
    aside: Callable[[], AbstractContextManager[None]],
    *,
    asked: bool,
) -> Easel:
    """A real easel with the person at this terminal beside it, or painting on it; a simulated one as it is.

    aside: holds whatever else is shown at the terminal while a question is asked; asked: whether the
    person at a robot is asked to fill its wells, or they are filled already.
    """
    site.require_somebody(asked=asked)
    if easel.simulated or not asked:
        return easel
    terminal = Terminal(
        lambda prompt: console.input(prompt, markup=False), lambda line: console.print(line, markup=False), folder
    )

    def answer(question: Question) -> Answer:
        with aside():
            return terminal.answer(question)

    return attended_by(easel, site, answer)


def attended_by(easel: Easel, site: Site, answer: Callable[[Question], Answer]) -> Easel:
    """A real easel with the person beside it, or painting on it, who answers questions; a simulated one as it is."""
    if easel.simulated:
        return easel
    if site.robot != HUMAN:
        return replace(easel, operator=PersonAsOperator(answer))
    hand = ByHand(easel, answer)
    return replace(easel, robot=hand, camera=hand.camera, operator=hand, foretell=hand.foretell)
