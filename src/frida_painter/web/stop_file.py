"""How the worker learns that a person has pressed stop."""

import threading
import time
from pathlib import Path

_BETWEEN_GLANCES = 0.02  # seconds, at the stop file


class StopPressed(Exception):
    """A person has pressed stop; the worker tells so and ends."""


class StopFileWatch:
    """Watches for the stop file on a thread of its own. (The robot's process watches for a file of its own.)"""

    def __init__(self, path: Path) -> None:
        self.asked = False
        self._path = path
        threading.Thread(target=self._watch, daemon=True, name="stop").start()

    def heed(self) -> None:
        """Ends what is being done where stop was pressed."""
        if self.asked:
            raise StopPressed

    def _watch(self) -> None:
        while not self._path.exists():
            time.sleep(_BETWEEN_GLANCES)
        self.asked = True
