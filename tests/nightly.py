"""What only the nightly run installs: `make nightly`, the extra `nightly` of pyproject.toml."""

from typing import Any

import pytest


def installed(module: str) -> Any:
    """Returns a module of a package of the extra; skips the test, or a file of tests, without it."""
    return pytest.importorskip(module, reason=f"only the nightly run installs what {module} is of")
