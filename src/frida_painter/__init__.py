"""FRIDA painter: a robot that paints with people.

`import frida_painter as fp` offers the names of __init__.pyi. Each name is loaded at its first use, so the import is
fast. docs/reference/python.md lists the other modules.
"""

from importlib import import_module
from pathlib import Path
from typing import Any

_LINES = Path(__file__).with_suffix(".pyi").read_text("utf-8").splitlines()
_HOMES = {words[-1]: (words[1], words[3]) for words in map(str.split, _LINES) if words[:1] == ["from"]}
"""Module of each public name, and its name there, from lines such as "from MODULE import NAME as PUBLIC"."""
__all__ = sorted(_HOMES)


def __getattr__(name: str) -> Any:
    if name == "__version__":
        from importlib.metadata import version

        found: Any = version("frida-painter")
    elif name in _HOMES:
        from frida_painter.system.python_process import prepare_forks

        module, inside = _HOMES[name]
        prepare_forks()
        found = vars(import_module(module)).get(inside) or import_module(f"{module}.{inside}")
    else:
        from difflib import get_close_matches

        near = get_close_matches(name, __all__, 1)
        meant = f"did you mean {near[0]}? It" if near else "it"
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}; {meant} offers {', '.join(__all__)}")
    globals()[name] = found  # the next access does not come here
    return found


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__, "__version__"})
