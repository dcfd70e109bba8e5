"""Worker process of the studio for all work but painting: it hears a stop from its first moment.

The libraries of a planner take seconds to load. This module loads none of them before it listens for stops.
"""

import os
from functools import partial
from pathlib import Path
from typing import BinaryIO

from frida_painter.session.events import Stopped
from frida_painter.system.python_process import in_own_process
from frida_painter_studio.at_page import Feed, StopWatch, telling_end
from frida_painter_studio.studio_folder import PLAN_JOB, PaintingFolder
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
    feed, stop = Feed(path), StopWatch(folder.stop, path.parent, what)
    if what == PLAN_JOB:
        stop.then(partial(end_at_once, folder))
    try:
        with telling_end(feed, stop):
            from frida_painter_studio.worker import Job, work

            work(what, Job(folder, easel, feed, stop), folder.plan(number))
    finally:
        lock.close()


def end_at_once(folder: PaintingFolder) -> None:
    """Reports a stop and ends the process: a planner holds no robot, and writes each file whole or not at all."""
    feed = Feed(folder.path)  # another one than that of the main thread, which may be about to write
    feed.tell(Stopped())
    feed.close()
    os._exit(0)
