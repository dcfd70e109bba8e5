"""Whether a process is busy computing, or stands still: by the processor time that it takes."""

import os
from pathlib import Path

from frida_painter.hardware.deadline import steady

_LOOK_EVERY = 0.5  # seconds
_BUSY = 0.02  # of that time on a processor; a process that was stopped, or hangs, takes none


class CpuActivity:
    """Asked often, tells whether the process of that number was busy in the last second.

    False as well where the system does not tell (Linux does).
    """

    def __init__(self, pid: int) -> None:
        self._stat = Path(f"/proc/{pid}/stat")
        self._at, self._used = steady(), self._taken()
        self._busy = False

    def __call__(self) -> bool:
        """Whether it was busy."""
        now = steady()
        if now - self._at >= _LOOK_EVERY:
            used = self._taken()
            self._busy = used - self._used >= _BUSY * (now - self._at)
            self._at, self._used = now, used
        return self._busy

    def _taken(self) -> float:
        """Seconds of all processors that it has taken so far."""
        try:
            fields = self._stat.read_text().rpartition(")")[2].split()  # its name may hold anything
            return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")
        except (OSError, ValueError, IndexError):
            return 0.0
