"""What processes of an engine are asked to do in tests: other processes find these functions by their names."""

import os
import signal
import sys
import time
from pathlib import Path

from frida_painter.errors import ConfigError, WorkerUnfit


def square(number: int) -> int:
    return number * number


def process(number: int) -> int:
    return os.getpid()


def is_loaded(name: str) -> bool:
    return name in sys.modules


def threads(number: int) -> int:
    import torch

    return torch.get_num_threads()


def fail_on_odd(number: int) -> int:
    if number % 2:
        raise ValueError(f"{number} is odd")
    return number


def refuse(number: int) -> int:
    raise ConfigError("Never.")


def unfit(number: int) -> int:
    raise WorkerUnfit("Another version.")


def first_try(folder: str) -> bool:
    """Whether it is called for the first time with this folder."""
    try:
        (Path(folder) / "tried").touch(exist_ok=False)
    except FileExistsError:
        return False
    return True


def die_at_first(folder: str) -> str:
    if first_try(folder):
        os.kill(os.getpid(), signal.SIGKILL)
    return "done"


def hang_at_first(folder: str) -> str:
    if first_try(folder):
        while True:
            time.sleep(0.1)
    return "done"


def hang(folder: str) -> str:
    (Path(folder) / str(os.getpid())).touch()
    time.sleep(1000)
    return "never"
