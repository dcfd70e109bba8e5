"""Easel of a studio: its robot, camera and workspace, and the easel's calibration record."""

from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, Self

from frida_painter.easel.kinds import HUMAN, NO_CAMERA, is_machine, is_simulated, require_equipment
from frida_painter_studio.reader import read_canvas

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
        return is_simulated(self.robot)

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

    @property
    def settings(self) -> dict[str, Any]:
        """Settings of `RunSpec` that describe this easel."""
        pace = self.pace if self.simulated else 0.0
        return {"robot": self.robot, "camera": self.camera, "workspace": self.workspace, "pace": pace}

    def validate(self) -> Self:
        """Returns the checked easel, with the canvas of its workspace file.

        Raises ConfigError for an unknown robot, for a missing workspace file or camera, or for a wrong workspace
        file.
        """
        if is_machine(self.robot):
            require_equipment(self.robot, self.workspace, self.camera)
        if self.workspace is None:
            return self
        return replace(self, canvas=read_canvas(self.workspace))
