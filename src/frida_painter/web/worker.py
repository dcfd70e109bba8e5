"""The process that works on one painting: it plans, or paints; the page starts it and may end before it does.

`python -m frida_painter.web.worker plan|paint FOLDER NUMBER LOCK`: the painting's folder, the number of
one of its plans, and the open file that holds the lock on the painting until the work is done.
"""

import os
import secrets
import sys
import time
import traceback
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path

import torch
from torch import Tensor

from frida_painter import images, storage
from frida_painter.cli import goals, kept
from frida_painter.cli.progress import Forecast
from frida_painter.cli.sitting import occasion, order
from frida_painter.config import PaintingSettings
from frida_painter.errors import FridaError, PaintingPaused, RobotStopped
from frida_painter.frames import PixelGrid
from frida_painter.plan import Plan
from frida_painter.planning.optimize import Step
from frida_painter.planning.planner import Planner
from frida_painter.report.recorder import Recorder
from frida_painter.session.easel_process import EaselProcess
from frida_painter.session.events import Event
from frida_painter.session.journal import Journal
from frida_painter.session.loop import PHOTOGRAPH_ROWS, Painting, Rhythm
from frida_painter.session.opening import open_planner, open_session, settle_threads
from frida_painter.web.feed import Feed
from frida_painter.web.folder import PaintingFolder, PlanFolder
from frida_painter.web.illustrations import Growing, illustrate, mixtures
from frida_painter.web.stop import Stop, StopPressed
from frida_painter.web.telling import Reporter
from frida_painter.web.together import Together

_GLIMPSES = 400
_GROWING_COST = 1.4  # later iterations, with all strokes placed, take longer than the first


def main() -> None:
    """Does the job; what goes wrong is told on the page in a sentence."""
    job, path, number, lock = sys.argv[1:]
    folder = PaintingFolder(Path(path))
    folder.live.mkdir(exist_ok=True)
    feed = Feed(folder)
    stop = Stop(folder.stop)
    settle_threads()
    try:
        {"plan": make_plan, "paint": paint}[job](folder, folder.plan(int(number)), feed, stop)
    except StopPressed:
        feed.tell("stopped")
    except FridaError as trouble:
        feed.tell("failed", sentence=str(trouble).replace(str(folder.path), "its folder"))
    except BaseException:
        mark = secrets.token_hex(4)
        print(mark, traceback.format_exc(), file=sys.stderr)
        feed.tell("failed", sentence=f"Something went wrong that should not have; its number in the log is {mark}.")
        raise
    finally:
        os.close(int(lock))
        feed.tell("rests")
        feed.close()


def _wished(place: PlanFolder) -> tuple[goals.Wanted, Planner]:
    """The goal, its pictures as they will fill the canvas, and the planner for it."""
    settings = place.wish().settings()
    wanted = goals.read_goal(None, {"goal": place.goal})
    grid = PixelGrid.of_height(settings.canvas, max(PHOTOGRAPH_ROWS, settings.render_height))
    wanted = wanted.fitted(grid)
    return wanted, open_planner(settings, wanted.goal)


def make_plan(folder: PaintingFolder, place: PlanFolder, feed: Feed, stop: Stop) -> None:
    """Makes the plan that was wished, and pictures of it."""
    _, planner = _wished(place)
    settings = place.wish().settings()
    bare = torch.ones(3, planner.fine.rows, planner.fine.columns)
    started = time.monotonic()

    def grown(name: str) -> None:
        feed.tell("sprouting", plan=place.number, picture=name)

    growing = Growing(place.path, bare, planner.model, planner.size, grown)

    def hear(step: Step) -> None:
        stop.heed()
        share = (step.iteration / step.of) ** _GROWING_COST
        feed.step("planning", share, (time.monotonic() - started) * (1 - share) / share, plan=place.number)
        growing.hear(step.strokes)

    made = planner.plan(bare, settings.strokes, settings.colors, hear)
    made.save(place.plan)
    expected = planner.expected(made, bare)
    nearer = 1 - planner.judge(expected) / max(planner.judge(bare), 1e-9)
    told = illustrate(made, planner.model, bare, place.path)
    told["mixtures"] = mixtures(made)
    feed.tell(
        "planned", plan=place.number, nearer=round(nearer, 4), seconds=round(time.monotonic() - started, 1), **told
    )


def paint(folder: PaintingFolder, place: PlanFolder, feed: Feed, stop: Stop) -> None:
    """Paints the plan, and plans the rest again at every look."""
    storage.new_folder(folder.painting)
    with ExitStack() as stack:
        process = stack.enter_context(EaselProcess())  # it loads while the planner does
        wanted, planner = _wished(place)
        settings, plan = place.wish().settings(), Plan.load(place.plan)
        # A stop latches the robot until somebody has looked; this one lives in the world of its painting alone.
        wanted_easel = order(settings, planner.model.brush, folder.painting, None, pace=0.0)
        easel = process.open(replace(wanted_easel, state=folder.path / "easel"))
        journal = _begin_journal(folder.painting, wanted, settings)
        stack.callback(journal.close)
        glimpses = min(len(plan), _GLIMPSES)
        what = replace(
            occasion(wanted, _target(wanted, settings), settings, planner.encoders),
            title=place.wish().title or "Untitled",
        )
        recorder = stack.enter_context(Recorder(folder.painting, what, planner.model, glimpses))
        reporter = Reporter(feed, folder, planner.model, planner.size, _forecast(planner, settings, glimpses))

        together = Together(folder, feed, stop)

        def hear(event: Event) -> None:
            recorder.hear(event)
            reporter.hear(event)
            together.hear(event)

        easel.robot.connect()
        easel.camera.connect()
        together.session = session = open_session(
            settings,
            planner,
            easel,
            glimpses=glimpses,
            stop_asked=lambda: stop.asked,
            pause_asked=together.pause_asked,
            go_on=together.go_on,
            notify=hear,
            journal=journal,
        )
        try:
            painting = session.run(settings.strokes, settings.colors, plan)
        except (RobotStopped, PaintingPaused):
            if not stop.asked:
                raise
            painting = Painting(reporter.seen, reporter.done, None)
            feed.tell("stopped", done=reporter.done)
        feed.tell("finishing")
        recorder.finish(painting)
        feed.tell("finished", film=(folder.painting / "film.mp4").exists())


def _target(wanted: goals.Wanted, settings: PaintingSettings) -> Tensor | None:
    grid = PixelGrid.of_height(settings.canvas, PHOTOGRAPH_ROWS)
    return None if wanted.picture is None else images.fit(wanted.picture, grid.rows, grid.columns)


def _forecast(planner: Planner, settings: PaintingSettings, glimpses: int) -> Forecast:
    again = planner.effort.refining + planner.effort.replanning
    rhythm = Rhythm(settings.replans, glimpses)
    return Forecast(settings.strokes, rhythm, time.monotonic(), planning=0, replanning=again)


def _begin_journal(folder: Path, wanted: goals.Wanted, settings: PaintingSettings) -> Journal:
    """Keeps in the folder what the command line keeps, so that it can resume the painting."""
    how = kept.Kept(settings, None, None, film=True)
    kept.keep_goal(wanted, folder)
    how.write(folder)
    return Journal.begin(folder, how.plain(), how.rests_on(folder))


if __name__ == "__main__":
    main()
