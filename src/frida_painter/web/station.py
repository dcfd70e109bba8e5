"""Where a studio's paintings are painted: the robot with its camera and workspace, and the easel's record."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Self

from frida_painter.config import PaintingSettings
from frida_painter.errors import ConfigError
from frida_painter.frames import CanvasSize
from frida_painter.hardware.stand import Stand
from frida_painter.session.easel_process import state_folder
from frida_painter.session.easels import HUMAN, OPENERS, SAWYER_SIM, SIMULATED, EaselOrder
from frida_painter.session.machines import MACHINES, MachineName
from frida_painter.web.folder import PaintingFolder


@dataclass(frozen=True)
class Station:
    """Chosen at the terminal that started the studio; no page can change it.

    record: the easel's calibration record, whether it is there already or not; robot, camera: by name;
    workspace: the file that says where things stand around a real robot; pace: how fast a simulated one
    moves, 1 as a real one, 0 as fast as can be computed.
    """

    record: Path
    robot: str = "virtual"
    camera: str = ""
    workspace: Path | None = None
    pace: float = 0.0

    @property
    def simulated(self) -> bool:
        """Whether no real robot is moved."""
        return self.robot in SIMULATED

    @property
    def dangerous(self) -> bool:
        """Whether a machine moves that could hurt somebody."""
        return not self.simulated and self.robot != HUMAN

    @property
    def known(self) -> Path | None:
        """The record, where there is one."""
        return self.record if self.record.is_file() else None

    @property
    def canvas(self) -> CanvasSize | None:
        """The canvas of the workspace file; None where any may be chosen. Raises ConfigError."""
        return None if self.workspace is None else Stand.load(self.workspace).canvas

    def require(self) -> None:
        """Raises ConfigError where there is no such robot, or it lacks a workspace file or a camera."""
        kind = MachineName.of(self.robot).kind
        if kind not in {*OPENERS, *MACHINES}:
            raise ConfigError(
                f"There is no robot {self.robot[:60]!r}; take {', '.join(OPENERS)}, or a real one: "
                f"{', '.join(MACHINES.values())}."
            )
        if kind in MACHINES and (self.workspace is None or not self.camera):
            raise ConfigError(
                f"The robot {self.robot[:60]!r} needs a workspace file (--workspace) and a camera (--camera); "
                "`frida-painter workspace example` prints a whole one."
            )
        if self.workspace is not None:
            Stand.load(self.workspace)

    def order(self, settings: PaintingSettings, brush: str, folder: PaintingFolder) -> EaselOrder:
        """The easel for a painting.

        A stop latches the robot until somebody has looked; a simulated one lives in the world of its painting alone.
        """
        return EaselOrder(
            robot=self.robot,
            canvas=settings.canvas,
            brush=brush,
            seed=settings.seed,
            state=folder.easel if self.simulated else state_folder(),
            folder=folder.painting.absolute(),
            workspace=None if self.workspace is None else self.workspace.absolute(),
            camera=self.camera,
            pace=self.pace if self.simulated else 0.0,
            film=self.robot == SAWYER_SIM,
        )

    def plain(self) -> dict[str, str]:
        """As plain values, for the processes that work."""
        workspace = "" if self.workspace is None else str(self.workspace.absolute())
        return {
            "record": str(self.record.absolute()),
            "robot": self.robot,
            "camera": self.camera,
            "workspace": workspace,
            "pace": str(self.pace),
        }

    @classmethod
    def take(cls, plain: Mapping[str, str]) -> Self:
        """From plain values."""
        workspace = Path(plain["workspace"]) if plain["workspace"] else None
        return cls(Path(plain["record"]), plain["robot"], plain["camera"], workspace, float(plain["pace"]))
