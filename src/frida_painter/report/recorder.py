"""The recorder of a session: keeps all records of a painting in one folder."""

import time
from collections.abc import Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import torch
from torch import Tensor

from frida_painter import images, storage
from frida_painter.brush.kinds import StrokeModel
from frida_painter.easel.kinds import ARM_FILM
from frida_painter.errors import ImageError, StorageError
from frida_painter.mixing.recipe import PaintSet, Recipe
from frida_painter.plan import Plan
from frida_painter.planning.forecast import SimilarityForecast
from frida_painter.planning.mixable import mixing_changes
from frida_painter.registry import Later
from frida_painter.report.film import FilmWriter, Sketchbook
from frida_painter.report.sheets import RecipeSheets, difference
from frida_painter.report.story import Download, Look, Phase, PictureComparison, Story, compare, paints
from frida_painter.session import events
from frida_painter.session.events import Event
from frida_painter.session.journal import History
from frida_painter.session.progress import Painting
from frida_painter.storage import count_of

# Results, which are written at the end.
_plan_widths = Later("frida_painter.export.vector:plan_widths")
_draw_svg = Later("frida_painter.export.vector:svg")
_write_table = Later("frida_painter.export.vector:table")
_write_page = Later("frida_painter.report.page:write_page")

_RESULT = "result.json"
_DOWNLOADS = (
    Download("plan.json", "the plan, to render or export again (belongs with its .safetensors file)"),
    Download("strokes.svg", "the strokes in millimetres, one layer per paint"),
    Download("strokes.csv", "the strokes as a table"),
    Download(_RESULT, "all figures, for programs"),
)


def _forecast_by(done: int) -> str:
    return f"Similarity forecast after {done} strokes" if done else "Similarity forecast by the first plan"


@dataclass
class Recorder:
    """Recorder of one painting: writes all its records into `folder` during the painting. Used in a `with` block.

    title, facts, settings: for the page and the result; a fact is (label, value)
    target: goal picture [3, H, W]; None if there is none
    models: stroke models of the brushes, by name
    timelapse_frames: expected number of the film's frames
    before: earlier runs from the journal; None if there are none
    has_camera: False if no camera looks at the canvas, so that the film shows what is expected
    watched: False if nobody photographed the finished canvas either
    owned: paints for the recipes; None for six common acrylics

    Every file is either complete or absent. During the painting, pictures are left out if the disk is full.
    Raises StorageError if the page or the painting cannot be written.
    """

    folder: Path
    title: str
    target: Tensor | None
    facts: tuple[tuple[str, str], ...]
    settings: dict[str, Any]
    models: Mapping[str, StrokeModel]
    timelapse_frames: int
    before: History | None = None
    has_camera: bool = True
    watched: bool = True
    owned: PaintSet | None = None
    _plan: Plan | None = field(default=None, init=False)
    _first_expected: Tensor | None = field(default=None, init=False)
    _looks: list[Look] = field(default_factory=list, init=False)
    _seen: events.Looked | None = field(default=None, init=False)
    _phases: list[Phase] = field(default_factory=list, init=False)
    _curve: list[tuple[int, float]] = field(default_factory=list, init=False)
    _dips: int = field(default=0, init=False)
    _cleanings: int = field(default=0, init=False)
    _strokes_left_out: list[int] = field(default_factory=list, init=False)
    _stopped: bool = field(default=False, init=False)
    _recipes: tuple[Recipe, ...] = field(default=(), init=False)
    _sheets: RecipeSheets = field(init=False)
    _left_out: int = field(default=0, init=False)
    _filming: bool = field(default=True, init=False)
    _in_hand: Future[None] | None = field(default=None, init=False)  # the timelapse frame in progress
    _expected_seconds: float | None = field(default=None, init=False)
    _forecasts: list[tuple[int, SimilarityForecast]] = field(default_factory=list, init=False)  # by strokes
    _touch: dict[str, str] = field(default_factory=dict, init=False)  # latest correction, by brush
    _goals: list[events.GoalChanged] = field(default_factory=list, init=False)

    def __enter__(self) -> Self:
        self._started = time.monotonic()
        self._sketchbook, self._sheets = Sketchbook(self.folder), RecipeSheets(self.folder, self.owned)
        if self.before is not None:
            self._dips, self._cleanings = self.before.dips, self.before.cleanings
            self._goals = list(self.before.goals)
            self._started -= self.before.seconds
        self._thread = ThreadPoolExecutor(1, "film")  # encodes while the robot goes on painting
        self._film = FilmWriter(self.folder / "film.mp4", self.timelapse_frames)
        if self.target is not None:
            images.save(self.target, self.folder / "target.jpg")
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._end_film()
        self._sheets.finish()

    def hear(self, event: Event) -> None:
        """Records an event."""
        try:
            self._keep(event)
        except StorageError:  # the painting is worth more than its pictures
            self._left_out += 1

    def _keep(self, event: Event) -> None:
        match event:
            case events.PlanningStep(iteration=iteration, loss=loss):
                self._curve.append((iteration, loss))
            case events.Planned():
                self._keep_plan(event)
            case events.Resumed():
                self._keep_on(event)
            case events.Scheduled(timetable=timetable, done=done) if done == 0 or self._expected_seconds is None:
                self._expected_seconds = timetable.total
                self._keep_story()
            case events.Dipped(cleaned=cleaned):
                self._dips += 1
                self._cleanings += int(cleaned)
            case events.TimelapseFrame():
                before, self._in_hand = self._in_hand, self._thread.submit(self._keep_timelapse_frame, event)
                if before is not None:
                    before.result()
            case events.Looked():
                self._seen = event
            case events.TouchCorrected(brush=brush):
                self._touch[brush] = event.sentence
            case events.StrokeLeftOut(done=done):
                self._strokes_left_out.append(done)
            case events.GoalChanged():
                self._goals.append(event)
            case events.Stopped():
                self._stopped = True
            case _:
                pass

    def finish(self, painting: Painting) -> Path | None:
        """Closes the film, writes pictures, exports, figures and the page; returns the page's path.

        Returns None if the work was stopped before there was a plan: then there is nothing to tell. Raises
        StorageError.
        """
        self._end_film()
        self._recipes, left_out = self._sheets.finish()
        self._left_out += left_out
        if self._plan is None or self._first_expected is None:
            return None
        painted = self._plan.part(slice(painting.painted))
        widths = _plan_widths(painted, self.models)
        storage.write_text(self.folder / "strokes.svg", _draw_svg(painted, widths))
        storage.write_text(self.folder / "strokes.csv", _write_table(painted))
        images.save(painting.photograph, self.folder / "painting.png")
        comparisons = self._compare(painting.photograph, self._first_expected)
        story = self._story(self._plan, painting, comparisons)
        page = _write_page(story, self.folder)
        self._write_result(self._plan, painting, comparisons)
        return page

    def _keep_plan(self, event: events.Planned) -> None:
        """Stores the whole plan: the painted strokes, then the remaining ones."""
        name = f"plan for {len(event.plan)} strokes" if event.done == 0 else f"after {event.done} strokes"
        self._phases.append(Phase(name, tuple(self._curve)))
        self._curve = []
        if event.forecast is not None:
            self._forecasts.append((event.done, event.forecast))
        if self._plan is None or event.done == 0:  # a plan for the measured paints replaces the first one
            self._plan, self._first_expected = event.plan, event.expected
            images.save(event.expected, self.folder / "plan.png")
            self._sheets.renew(event.plan)
        else:
            before, self._plan = self._plan, self._plan.part(slice(event.done)).followed_by(event.plan)
            if not torch.equal(before.palette.color, self._plan.palette.color):  # new paints for the next layer
                self._sheets.renew(self._plan, before.palette)
            if self._seen is not None:
                self._looks.append(self._keep_look(self._seen, event))
        self._keep_story()

    def _keep_story(self) -> None:
        self._sketchbook.keep_story(self._looks, self._phases, self._expected_seconds)

    def _keep_on(self, event: events.Resumed) -> None:
        """Continues film and story of an earlier run."""
        self._plan = event.plan
        self._sheets.renew(event.plan)
        self._looks, self._phases, self._expected_seconds = self._sketchbook.story()
        try:
            self._first_expected = images.load(self.folder / "plan.png")
        except ImageError:
            self._first_expected = event.expected
        for stroke, picture in self._sketchbook.timelapse_frames(event.done):
            red, green, blue = event.plan.strokes.color[stroke - 1].tolist()
            self._show(picture, stroke / len(event.plan), (red, green, blue))

    def _keep_timelapse_frame(self, frame: events.TimelapseFrame) -> None:
        self._sketchbook.keep_timelapse_frame(frame.done, frame.photograph)
        self._show(frame.photograph, frame.done / frame.of, frame.color)

    def _end_film(self) -> None:
        """Waits for the frame in progress, and closes the film."""
        in_hand, self._in_hand = self._in_hand, None
        try:
            try:
                if in_hand is not None:
                    in_hand.result()
            finally:
                self._thread.shutdown()
                self._film.__exit__(None, None, None)
        except StorageError:
            self._left_out += 1

    def _show(self, picture: Tensor, done: float, color: tuple[float, float, float]) -> None:
        """Adds a picture at a share of the strokes to the film, unless an earlier write failed."""
        if self._filming:
            try:
                self._film.add(images.to_uint8(picture), done, color)
            except StorageError:
                self._filming = False
                raise

    @property
    def _runs(self) -> int:
        return 1 if self.before is None else self.before.runs + int(not self.before.finished)

    def _keep_look(self, seen: events.Looked, planned: events.Planned) -> Look:
        number = storage.next_number(self.folder, "look-")
        rows, columns = seen.expected.shape[1:]
        pictures = {
            "photograph": seen.photograph,
            "expected": seen.expected,
            "difference": difference(seen.expected, images.fit(seen.photograph, rows, columns)),
            "plan": planned.expected,
        }
        names = {}
        for name, picture in pictures.items():
            names[name] = f"look-{number}-{name}.jpg"
            images.save(picture, self.folder / names[name])
        text = (
            f"After {count_of(seen.done, 'stroke')} the painter looked, and planned the {len(planned.plan)} that were "
            f"left again: the finished painting should come {100 * planned.gain:.0f} % nearer to the goal than if it "
            "had gone on blindly."
        )
        if planned.forecast is not None:
            text += f" Its similarity to the photograph (PSNR): {planned.forecast}."
        return Look(
            strokes=seen.done, loss_before=planned.loss_before, loss_after=planned.loss_after, text=text, **names
        )

    def _compare(self, photograph: Tensor, first_expected: Tensor) -> tuple[PictureComparison, ...]:
        """Returns comparisons of plan, painting and, if there is one, target, at the plan's resolution."""
        rows, columns = first_expected.shape[1:]
        if not self.watched:  # nobody knows how near the painting came
            wanted = None if self.target is None else images.fit(self.target, rows, columns)
            label = "The first plan against the photograph"
            return () if wanted is None else (compare(label, first_expected, wanted),)
        painted = images.fit(photograph, rows, columns)
        against_plan = compare("The painting against the first plan", painted, first_expected)
        if self.target is None:
            return (against_plan,)
        target = images.fit(self.target, rows, columns)
        planned = compare("The first plan against the photograph", first_expected, target)
        return (planned, compare("The painting against the photograph", painted, target), against_plan)

    def _story(self, plan: Plan, painting: Painting, comparisons: tuple[PictureComparison, ...]) -> Story:
        painted = painting.painted
        of = len(plan)
        count = count_of(of, "stroke") if painted == of else f"{painted} of {count_of(of, 'stroke')}"
        looked = f", {count_of(len(self._looks), 'look')} in between" if self._looks else ""
        facts = (
            *self.facts,
            *(
                ("Goal changed", f"after {count_of(each.done, 'stroke')}: {'; '.join(each.facts)}")
                for each in self._goals
            ),
            *mixing_changes(plan).items(),
            ("Strokes", f"{painted} of {of}"),
            *[(_forecast_by(done), str(one)) for done, one in self._forecasts[:1]],
            ("Dips into paint", str(self._dips)),
            ("Brush cleaned", count_of(self._cleanings, "time")),
            ("Made in", f"{time.monotonic() - self._started:.0f} s"),
            *self._mishaps(painting.remark),
            *([("Robot's clock", self._clock(painting))] if self._expected_seconds else []),
        )
        return Story(
            title=self.title,
            summary=f"{count} in {count_of(len(plan.palette), 'paint')} on a canvas of {plan.canvas}{looked}.",
            target=None if self.target is None else "target.jpg",
            plan="plan.png",
            painting="painting.png",
            film="film.mp4" if (self.folder / "film.mp4").exists() else None,
            palette_sheet="palette.png",
            paints=paints(plan, self._recipes),
            mixing_sheet="mixing.png" if self._recipes else None,
            looks=tuple(self._looks),
            phases=tuple(self._phases),
            comparisons=comparisons,
            facts=facts,
            downloads=_DOWNLOADS,
            stopped=self._stopped,
            watched=self.watched,
            has_camera=self.has_camera,
            arm_film=ARM_FILM if (self.folder / ARM_FILM).exists() else None,
        )

    @property
    def _given_up(self) -> list[int]:
        """Numbers of the planned strokes that are not on the canvas."""
        return [*(self.before.given_up if self.before is not None else []), *self._strokes_left_out]

    def _mishaps(self, remark: str) -> tuple[tuple[str, str], ...]:
        """Returns deviations from the normal course, for the page."""
        facts: list[tuple[str, str]] = []
        if self.before is not None:
            facts.append(("Sittings", str(self._runs)))
        if self._given_up:
            facts.append(("Strokes given up", ", ".join(map(str, self._given_up))))
        facts += [("Brush heights", sentence) for sentence in self._touch.values()]
        if remark:
            facts.append(("Last look", remark))
        if self._left_out:
            facts.append(("Pictures left out", f"{self._left_out}, for want of space on the disk"))
        return tuple(facts)

    def _clock(self, painting: Painting) -> str:
        expected = self._expected_seconds or 0.0
        return f"{painting.robot_seconds / 60:.1f} min, {expected / 60:.1f} expected"

    def _write_result(self, plan: Plan, painting: Painting, comparisons: tuple[PictureComparison, ...]) -> None:
        storage.write_json(
            self.folder / _RESULT,
            {
                "format": "frida-painter result",
                "version": 1,
                "title": self.title,
                "stopped": self._stopped,
                "photographed": self.watched,
                "settings": self.settings,
                "goal_changes": [{"strokes": each.done, "goal": list(each.facts)} for each in self._goals],
                "strokes_planned": len(plan),
                "strokes_painted": painting.painted - len(self._given_up),
                "dips": self._dips,
                "cleanings": self._cleanings,
                "seconds": round(time.monotonic() - self._started, 3),
                "sittings": self._runs,
                "strokes_given_up": self._given_up,
                "robot_seconds": round(painting.robot_seconds, 3),
                "robot_seconds_expected": round(self._expected_seconds, 3) if self._expected_seconds else None,
                "plan_digest": plan.digest,
                "palette": [paint.hex for paint in paints(plan)],
                "comparisons": [
                    {"what": one.label, "psnr_db": round(one.psnr, 3), "lab_distance": round(one.distance, 3)}
                    for one in comparisons
                ],
                "forecasts": [
                    {
                        "strokes": done,
                        "expected_psnr_db": round(one.expected, 3),
                        "least_psnr_db": round(one.least, 3),
                        "most_psnr_db": round(one.most, 3),
                    }
                    for done, one in self._forecasts
                ],
                "looks": [
                    {"strokes": look.strokes, "loss_before": look.loss_before, "loss_after": look.loss_after}
                    for look in self._looks
                ],
                "files": sorted({path.name for path in self.folder.iterdir() if path.name[0] != "."} | {_RESULT}),
            },
        )
