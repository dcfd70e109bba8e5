"""Packages that only some commands need: each comes with an extra of this distribution, and a missing one is named.

The extras stand in pyproject.toml. A module imports such a package inside a function, right after `require`.
"""

import sys
from importlib.util import find_spec

from frida_painter.errors import ConfigError, FridaError


def is_installed(package: str) -> bool:
    """Whether `package`, by the name it is imported with, can be imported. It is looked for and not loaded."""
    if package in sys.modules:
        return sys.modules[package] is not None
    return find_spec(package) is not None


def advice(extra: str, user: str) -> str:
    """One sentence that names the extra which `user`, the sentence's subject, needs, and the command to install it."""
    return f'{user} needs the extra "{extra}", which is not installed; say: pip install "frida-painter[{extra}]"'


def require(extra: str, package: str, user: str, error: type[FridaError] = ConfigError) -> None:
    """Raises `error` with that advice unless `package` is installed.

    extra: the extra that installs it; user: what needs it, such as "The studio".
    """
    if not is_installed(package):
        raise error(advice(extra, user))
