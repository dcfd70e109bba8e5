"""Everything that a package of your own parts needs, in one module: `from frida_painter.plugins import GoalKind`.

The names here are a promise. Versions are semantic: a name, or what it promises, changes only in a version that says
so in its notes, and what goes away still works, with a DeprecationWarning, for two minor versions. `check` tries the
parts of a package.

    >>> import frida_painter as fp
    >>> [finding.name for finding in fp.plugins.check("frida-painter", kinds=["exporters"])]
    ['svg', 'gcode', 'csv', 'png']

plugins.pyi lists the names. Each is loaded at its first use, so that a part may import this module where it may not
load PyTorch.
"""

from importlib import import_module
from pathlib import Path
from typing import Any

_LINES = Path(__file__).with_suffix(".pyi").read_text("utf-8").splitlines()
_NAMES = {words[3]: words[1] for words in map(str.split, _LINES) if words[:1] == ["from"]}
"""Module of each name."""
__all__ = sorted(_NAMES)


def __getattr__(name: str) -> Any:
    if name not in _NAMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}; it offers {', '.join(__all__)}")
    found = getattr(import_module(_NAMES[name]), name)
    globals()[name] = found
    return found


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
