"""The easel of a studio: its robot, camera and workspace, and the easel's calibration record."""

import json
import subprocess
import sys
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Self

from frida_painter.easel.kinds import HUMAN, MACHINES, SIMULATED, require_known
from frida_painter.errors import ConfigError

# Reads the canvas size from a workspace file in a short process of its own.
#
# The code that reads such a file imports arrays and tensors, and the web app's process stays without them.

_PATIENCE = 60.0


def canvas_of_workspace(workspace: Path) -> tuple[float, float]:
    """Width and height of the canvas in millimetres. Raises ConfigError where the file is no workspace."""
    program = [sys.executable, "-m", "frida_painter.web.workspace_reader", str(workspace)]
    said = subprocess.run(program, stdin=subprocess.DEVNULL, capture_output=True, text=True, timeout=_PATIENCE)
    found = json.loads(said.stdout)
    if "fault" in found:
        raise ConfigError(found["fault"])
    width, height = found["canvas"]
    return float(width), float(height)


LOCAL = "127.0.0.1"
"""The address at which a studio can be reached from its own machine only."""


@dataclass(frozen=True)
class StudioEasel:
    """The easel that was chosen at the terminal which started the studio; no page can change it.

    record: the file of the easel's calibration record, which need not exist yet; robot, camera: by name;
    workspace: the workspace file of a real robot; pace: how fast a simulated robot moves, 1 as a real one, 0 as
    fast as can be computed; canvas: width and height in millimetres from the workspace file, None where any may
    be chosen.
    """

    record: Path
    robot: str = "virtual"
    camera: str = ""
    workspace: Path | None = None
    pace: float = 0.0
    canvas: tuple[float, float] | None = None

    @cached_property
    def simulated(self) -> bool:
        """Whether no real robot is moved. (Kept: it asks all that is installed, which is not for every request.)"""
        return self.robot in SIMULATED

    @property
    def drives_machine(self) -> bool:
        """Whether a machine moves by its own power, so that it could hurt somebody."""
        return not self.simulated and self.robot != HUMAN

    @property
    def known(self) -> Path | None:
        """The record, where there is one."""
        return self.record if self.record.is_file() else None

    def validated(self) -> Self:
        """The same, checked, with the canvas of its workspace file.

        Raises ConfigError where there is no such robot, it lacks a workspace file or a camera, or that file is wrong.
        """
        if require_known(self.robot) in MACHINES and (self.workspace is None or not self.camera):
            raise ConfigError(
                f"The robot {self.robot[:60]!r} needs a workspace file (--workspace) and a camera (--camera); "
                "`frida-painter workspace example` prints a whole one."
            )
        return self if self.workspace is None else replace(self, canvas=canvas_of_workspace(self.workspace))

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
