"""`frida-painter` in the process of the tests."""

import sys
from collections.abc import Callable
from typing import NamedTuple
from unittest.mock import patch

import pytest

from frida_painter_cli import commands


class Said(NamedTuple):
    """What a command said, and its exit status."""

    status: int
    out: str
    err: str

    @property
    def briefly(self) -> tuple[int, str]:
        """Exit status, and all that was said, on one line."""
        return self.status, " ".join((self.out + self.err).split())


Command = Callable[..., Said]


def run_command(*words: object) -> int:
    """Runs `frida-painter WORD ...`; returns its exit status."""
    with patch.object(sys, "argv", ["frida-painter", *map(str, words)]), pytest.raises(SystemExit) as end:
        commands.main()
    return int(end.value.code or 0)
