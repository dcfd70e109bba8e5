"""The process that does one piece of work: it plans, paints or calibrates; the page starts it and may end before it.

`python -m frida_painter.web.worker JOB FOLDER NUMBER LOCK EASEL`: what to do, the painting's folder, the number of
one of its plans, the open file that holds the lock on the painting until the work is done, and the studio's easel
as JSON.
"""

import json
import os
import secrets
import sys
import time
import traceback
from pathlib import Path

from frida_painter.errors import ConfigError, FridaError, RobotStopped
from frida_painter.planning.optimize import Step
from frida_painter.runs.run import PaintingRun
from frida_painter.session.events import Failed, Stopped
from frida_painter.session.opening import prepare_process
from frida_painter.session.page_events import PlanMade, PlanPreview, Rests
from frida_painter.web.asking import Asker
from frida_painter.web.calibration_worker import calibrate
from frida_painter.web.exports import export
from frida_painter.web.feed import Feed
from frida_painter.web.folder import PaintingFolder, PlanFolder
from frida_painter.web.illustrations import Growing, illustrate, mixtures
from frida_painter.web.job import Job
from frida_painter.web.painting_worker import paint, resume
from frida_painter.web.stop_line import StopPressed, StopWatch
from frida_painter.web.studio_easel import StudioEasel

_GROWING_COST = 1.4  # later iterations, with all strokes placed, take longer than the first


def main() -> None:
    """Does the job; what goes wrong is told on the page in a sentence."""
    what, path, number, lock, easel = sys.argv[1:]
    folder = PaintingFolder(Path(path))
    folder.live.mkdir(exist_ok=True)
    feed = Feed(folder)
    stop = StopWatch(folder.stop, folder.path.parent)
    prepare_process()
    try:
        job = Job(folder, StudioEasel.take(json.loads(easel)), feed, stop, Asker(folder, feed, stop))
        work(what, job, folder.plan(int(number)))
    except StopPressed:
        feed.tell(Stopped())
    except FridaError as trouble:
        if stop.asked and isinstance(trouble, RobotStopped):
            feed.tell(Stopped())
        else:
            feed.tell(Failed(str(trouble).replace(str(folder.path), "its folder")))
    except BaseException:
        mark = secrets.token_hex(4)
        print(mark, traceback.format_exc(), file=sys.stderr)
        feed.tell(Failed(f"Something went wrong that should not have; its number in the log is {mark}."))
        raise
    finally:
        os.close(int(lock))
        feed.tell(Rests())
        feed.close()


def work(what: str, job: Job, place: PlanFolder) -> None:
    """Does it."""
    match what:
        case "plan":
            make_plan(job, place)
        case "paint":
            paint(job, place)
        case "resume":
            resume(job, place)
        case "calibrate":
            calibrate(job)
        case _:
            raise ConfigError(f"There is no job {what[:40]!r}; it is plan, paint, resume or calibrate.")


def make_plan(job: Job, place: PlanFolder) -> None:
    """Makes the plan that was asked for, and pictures of it."""
    feed = job.feed
    with PaintingRun(job.spec(place)) as run:
        run.choosing = lambda what: job.stop.heed()
        planner = run.planner
        bare = planner.bare
        started = time.monotonic()

        def grown(name: str) -> None:
            feed.tell(PlanPreview(name, place.number))

        growing = Growing(place.path, bare, planner.models, planner.size, grown)

        def hear(step: Step) -> None:
            job.stop.heed()
            share = (step.iteration / step.of) ** _GROWING_COST
            feed.step(share, (time.monotonic() - started) * (1 - share) / share, place.number)
            growing.hear(step.parts)

        made = run.plan(hear)
        made.save(place.plan)
        export(made, planner.models, place.path, run.spec.drying)
        expected = planner.expected(made, bare)
        nearer = 1 - planner.validation_loss(expected) / max(planner.validation_loss(bare), 1e-9)
        told = illustrate(made, planner.models, bare, place.path)
        mixed, took = mixtures(made), round(time.monotonic() - started, 1)
    feed.tell(PlanMade(place.number, round(nearer, 4), took, mixtures=mixed, **told))


if __name__ == "__main__":
    main()
