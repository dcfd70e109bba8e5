"""Easel of a studio: its robot, camera and workspace, and the easel's calibration record."""

import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Self

from frida_painter import python_process
from frida_painter.easel.kinds import HUMAN, MACHINES, NO_CAMERA, SIMULATED, require_equipment, require_known
from frida_painter.errors import ConfigError

# Canvas size of a workspace file, read in a short process.
#
# The code that reads the file imports arrays and tensors, which the web process must not load.

_PATIENCE = 60.0


def canvas_of_workspace(workspace: Path) -> tuple[float, float]:
    """Returns width and height of the canvas in millimetres. Raises ConfigError if the file is no workspace."""
    said = python_process.run("-m", "frida_painter.web.workspace_reader", workspace, text=True, timeout=_PATIENCE)
    found = json.loads(said.stdout)
    if "fault" in found:
        raise ConfigError(found["fault"])
    width, height = found["canvas"]
    return float(width), float(height)


LOCAL = "127.0.0.1"
"""Address that only the studio's own machine can reach."""


@dataclass(frozen=True)
class WebAppEasel:
    """Easel that the terminal command of the studio chose; no page can change it.

    record: file of the calibration record, which need not exist yet.
    robot, camera: names.
    workspace: workspace file of a real robot.
    pace: speed of a simulated robot: 1 like a real one, 0 as fast as possible.
    canvas: width and height in millimetres from the workspace file. None: any size.
    """

    record: Path
    robot: str = "virtual"
    camera: str = ""
    workspace: Path | None = None
    pace: float = 0.0
    canvas: tuple[float, float] | None = None

    @cached_property
    def simulated(self) -> bool:
        """True if no real robot moves; cached, because it asks all installed packages."""
        return self.robot in SIMULATED

    @property
    def has_camera(self) -> bool:
        """False if nobody looks at the canvas of a painting."""
        return self.camera != NO_CAMERA

    @property
    def drives_machine(self) -> bool:
        """True if a machine moves by its own power and could hurt somebody."""
        return not self.simulated and self.robot != HUMAN

    @property
    def known(self) -> Path | None:
        """File of the record; None if it does not exist."""
        return self.record if self.record.is_file() else None

    def validate(self) -> Self:
        """Returns the checked easel, with the canvas of its workspace file.

        Raises ConfigError for an unknown robot, for a missing workspace file or camera, or for a wrong workspace
        file.
        """
        if require_known(self.robot) in MACHINES:
            require_equipment(self.robot, self.workspace, self.camera)
        return self if self.workspace is None else replace(self, canvas=canvas_of_workspace(self.workspace))

    def plain(self) -> dict[str, str]:
        """Returns the easel as plain values, for worker processes."""
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
        """Returns the easel from plain values."""
        workspace = Path(plain["workspace"]) if plain["workspace"] else None
        return cls(Path(plain["record"]), plain["robot"], plain["camera"], workspace, float(plain["pace"]))
