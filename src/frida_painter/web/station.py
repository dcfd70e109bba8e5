"""Where a studio's paintings are painted: the robot with its camera and workspace, and the easel's record."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Self

from frida_painter.errors import ConfigError
from frida_painter.session.names import HUMAN, MACHINES, SIMULATED, require_known
from frida_painter.web.surveying import survey

LOCAL = "127.0.0.1"
"""The address at which a studio can be reached from its own machine only."""


@dataclass(frozen=True)
class Station:
    """Chosen at the terminal that started the studio; no page can change it.

    record: the easel's calibration record, whether it is there already or not; robot, camera: by name;
    workspace: the file that says where things stand around a real robot; pace: how fast a simulated one
    moves, 1 as a real one, 0 as fast as can be computed; canvas: width and height in millimetres where the
    workspace says them, None where any may be chosen.
    """

    record: Path
    robot: str = "virtual"
    camera: str = ""
    workspace: Path | None = None
    pace: float = 0.0
    canvas: tuple[float, float] | None = None

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

    def surveyed(self) -> Self:
        """The same, with the canvas of its workspace file.

        Raises ConfigError where there is no such robot, it lacks a workspace file or a camera, or that file is wrong.
        """
        if require_known(self.robot) in MACHINES and (self.workspace is None or not self.camera):
            raise ConfigError(
                f"The robot {self.robot[:60]!r} needs a workspace file (--workspace) and a camera (--camera); "
                "`frida-painter workspace example` prints a whole one."
            )
        return self if self.workspace is None else replace(self, canvas=survey(self.workspace))

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
