"""Process that prints the canvas size of a workspace file: `python -m frida_painter.web.workspace_reader FILE`.

web/web_app_easel.py runs it.
"""

import json
import sys
from pathlib import Path

from frida_painter.errors import ConfigError
from frida_painter.hardware.workcell import WorkcellConfig


def main() -> None:
    """Prints {"canvas": [width, height]} in millimetres, or {"fault": a sentence}."""
    try:
        size = WorkcellConfig.load(Path(sys.argv[1])).canvas
    except ConfigError as fault:
        print(json.dumps({"fault": str(fault)}))
    else:
        print(json.dumps({"canvas": [1000 * size.width, 1000 * size.height]}))


if __name__ == "__main__":
    main()
