"""Processes that die: work is done in a process of its own, which is killed in the moment that its journal tells."""

import os
import signal
import sys
import traceback
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from frida_painter.event_log import EventLog


def kill_when(journal: Path, moment: Callable[[dict[str, Any]], bool], work: Callable[[], None]) -> None:
    """Does the work in a process that is killed (SIGKILL) as soon as a record of the journal is the moment.

    The process kills itself, right after the record has been written to the disk: whoever watches from outside
    comes some strokes late where the machine is busy.
    """
    child = os.fork()
    if child == 0:
        try:
            _die_at(journal, moment)
            work()
        except BaseException:
            traceback.print_exc()
        finally:
            sys.stderr.flush()
            os._exit(1)
    _, status = os.waitpid(child, 0)
    assert os.waitstatus_to_exitcode(status) == -signal.SIGKILL, "the work ended before the moment came"


def began(stroke: int) -> Callable[[dict[str, Any]], bool]:
    """The moment in which a stroke is begun."""
    return lambda record: record["kind"] == "motion_began" and record.get("stroke") == stroke


def ended(stroke: int) -> Callable[[dict[str, Any]], bool]:
    """The moment in which a stroke is done."""
    return lambda record: record["kind"] == "stroke_painted" and record["done"] == stroke


def _die_at(journal: Path, moment: Callable[[dict[str, Any]], bool]) -> None:
    """Of this process, which is never used again."""
    append = EventLog.append

    def append_and_look(self: EventLog, record: Mapping[str, Any], **how: Any) -> None:
        append(self, record, **how)
        if self.path == journal and any(moment(one) for one in EventLog.read(journal)):
            os.kill(os.getpid(), signal.SIGKILL)

    EventLog.append = append_and_look  # type: ignore[method-assign]
