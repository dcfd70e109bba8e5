"""What processes of an engine are asked to do in tests: other processes find these functions by their names."""

import os
import signal
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from frida_painter.errors import ConfigError, WorkerUnfit


@dataclass(frozen=True)
class Note:
    """A task whose work leaves files in a folder."""

    keep: str
    keys: list[str]

    def write(self, name: str, content: object) -> None:
        (Path(self.keep) / name).write_text(str(content))

    def is_first_try(self) -> bool:
        try:
            (Path(self.keep) / "tried").touch(exist_ok=False)
        except FileExistsError:
            return False
        return True


reopen: Callable[[str, list[str]], Note] = Note


def tell_process(note: Note) -> None:
    import torch

    note.write(*note.keys, f"{os.getpid()} {torch.get_num_threads()}")


def fail_on_odd(note: Note) -> None:
    (number,) = map(int, note.keys)
    if number % 2:
        raise ValueError(f"{number} is odd")
    tell_process(note)


def refuse(note: Note) -> None:
    raise ConfigError("Never.")


def unfit(note: Note) -> None:
    note.write(str(os.getpid()), "tried")
    raise WorkerUnfit("Another version.")


def die_at_first(note: Note) -> None:
    if note.is_first_try():
        os.kill(os.getpid(), signal.SIGKILL)


def hang_at_first(note: Note) -> None:
    while note.is_first_try() or not (Path(note.keep) / "tried").exists():
        time.sleep(1000)


def hang(note: Note) -> None:
    note.write(str(os.getpid()), "hangs")
    time.sleep(1000)


def hang_in_place(note: Note) -> None:
    if Path(note.keep).name != "done":
        hang(note)
