"""Processes that die: work is done in a process of its own, which is killed in the moment that its journal tells."""

import os
import signal
import sys
import time
import traceback
from collections.abc import Callable
from pathlib import Path
from typing import Any

from frida_painter.errors import StorageError
from frida_painter.event_log import EventLog

_PATIENCE = 240


def kill_when(journal: Path, moment: Callable[[dict[str, Any]], bool], work: Callable[[], None]) -> None:
    """Does the work in a process that is killed (SIGKILL) as soon as a record of the journal is the moment."""
    child = os.fork()
    if child == 0:
        try:
            work()
        except BaseException:
            traceback.print_exc()
        finally:
            sys.stderr.flush()
            os._exit(1)
    try:
        deadline = time.monotonic() + _PATIENCE
        while not any(moment(record) for record in _records(journal)):
            assert time.monotonic() < deadline, "the moment never came"
            # Without reaping it: its number must stay its own until it is killed.
            ended = os.waitid(os.P_PID, child, os.WEXITED | os.WNOHANG | os.WNOWAIT)
            assert ended is None, "the work ended before the moment came"
            time.sleep(0.001)
    finally:
        os.kill(child, signal.SIGKILL)
        os.waitpid(child, 0)


def began(stroke: int) -> Callable[[dict[str, Any]], bool]:
    """The moment in which a stroke is begun."""
    return lambda record: record["kind"] == "motion_began" and record.get("stroke") == stroke


def ended(stroke: int) -> Callable[[dict[str, Any]], bool]:
    """The moment in which a stroke is done."""
    return lambda record: record["kind"] == "stroke_painted" and record["done"] == stroke


def _records(journal: Path) -> list[dict[str, Any]]:
    try:
        return EventLog.read(journal)
    except StorageError:  # there is none yet
        return []
