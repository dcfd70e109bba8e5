"""Reads the canvas size from a workspace file in a short process of its own.

The code that reads such a file imports arrays and tensors, and the web app's process stays without them.
"""

import json
import subprocess
import sys
from pathlib import Path

from frida_painter.errors import ConfigError

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
