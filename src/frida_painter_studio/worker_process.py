"""Worker process of the studio: it hears a stop from its first moment; it may outlive the page's process.

The libraries of a planner take seconds to load. This module loads none of them before it listens for stops.
"""

import os
import secrets
import sys
import traceback
from functools import partial
from pathlib import Path
from typing import BinaryIO

from frida_painter import registry
from frida_painter.errors import FridaError, RobotStopped
from frida_painter.session.events import Stopped
from frida_painter.system.python_process import in_own_process
from frida_painter_studio.stop import StopPressed, StopWatch
from frida_painter_studio.studio_folder import PLAN_JOB, Feed, PaintingFolder
from frida_painter_studio.web_app_easel import WebAppEasel


@in_own_process()
def do_job(what: str, path: Path, number: int, lock: BinaryIO, easel: WebAppEasel) -> None:
    """Does a job; errors are reported on the page as a sentence.

    what: the job, as in `work`
    path: folder of the painting
    number: of one of its plans
    lock: lock file of the painting, held until the work is done
    easel: of the studio
    """
    folder = PaintingFolder(path)
    feed = Feed(folder)
    stop = StopWatch(folder.stop, folder.path.parent, what)
    if what == PLAN_JOB:
        stop.then(partial(end_at_once, folder))
    try:
        from frida_painter_studio.worker import Job, work

        job = Job(folder, easel, feed, stop)
        work(what, job, folder.plan(number))
    except StopPressed:
        feed.tell(Stopped())
    except FridaError as trouble:
        if stop.asked and isinstance(trouble, RobotStopped):
            feed.tell(Stopped())
        else:
            feed.tell(Stopped(str(trouble).replace(str(folder.path), "its folder")))
    except BaseException as failure:
        mark = secrets.token_hex(4)
        print(mark, traceback.format_exc(), file=sys.stderr)
        told = f"Something went wrong that should not have; its number in the log is {mark}."
        feed.tell(Stopped(str(registry.blame(failure) or told)))
        raise
    finally:
        folder.forget_stop()
        lock.close()
        feed.close()


def end_at_once(folder: PaintingFolder) -> None:
    """Reports a stop and ends the process: a planner holds no robot, and writes each file whole or not at all."""
    feed = Feed(folder)  # another one than that of the main thread, which may be about to write
    feed.tell(Stopped())
    feed.close()
    os._exit(0)
