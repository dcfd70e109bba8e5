"""The recorder of a session: pictures and film of a painting while it is made, and its results at the end.

Facts and figures are those of `PaintingState`.
"""

from collections.abc import Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from frida_painter.brush.kinds import StrokeModel
from frida_painter.easel.kinds import ARM_FILM
from frida_painter.errors import ImageError, StorageError
from frida_painter.mixing.recipe import PaintSet
from frida_painter.mixing.shopping import BrushPaints, supplies
from frida_painter.registry import Later
from frida_painter.report.film import FilmWriter, keep_frame, kept_frames
from frida_painter.report.sheets import RecipeSheets, card, difference
from frida_painter.report.story import PictureComparison, compare, paints
from frida_painter.session import events
from frida_painter.session.events import Event
from frida_painter.session.fold import LookState, PaintingState
from frida_painter.session.progress import Painting
from frida_painter.strokes.plan import Plan
from frida_painter.system import images, storage
from frida_painter.system.storage import count_of

# Results, which are written at the end.
_plan_widths = Later("frida_painter.report.vector:plan_widths")
_draw_svg = Later("frida_painter.report.vector:svg")
_write_table = Later("frida_painter.report.vector:table")
_write_page = Later("frida_painter.report.page:write_page")

_RESULT, _TARGET, _CANVAS, _PAINTING = "result.json", "target.jpg", "canvas.png", "painting.png"
_CARD, _NEARNESS = "card.jpg", "The painting against the photograph"
_FORECAST = ("expected_psnr_db", "least_psnr_db", "most_psnr_db")


@dataclass(frozen=True)
class Description:
    """Description of a painting for its report.

    target: goal picture [3, H, W]; None if there is none
    facts, settings: for the page, as (label, value), and for the result
    frames: expected number of the film's frames
    has_camera: False if no camera looks at the canvas, so that the film shows what is expected
    owned: paints for the recipes; None for six common acrylics
    is_mixed: False if nobody mixes paints, so that the recipes are only needed at the end
    """

    title: str
    target: Tensor | None
    facts: tuple[tuple[str, str], ...]
    settings: dict[str, Any]
    frames: int
    has_camera: bool = True
    owned: PaintSet | None = None
    is_mixed: bool = True


class Recorder:
    """Recorder of one painting: writes pictures, film and results into `folder`. Used in a `with` block.

    models: stroke models of the brushes, by name
    state: of the painting, with its earlier sittings
    similarity: of the finished painting to its photograph or else to the first plan, in words; "" if not known

    Every file is either complete or absent. During the painting, pictures are left out if the disk is full.
    Raises StorageError if the page or the painting cannot be written.
    """

    def __init__(
        self, folder: Path, described: Description, models: Mapping[str, StrokeModel], state: PaintingState
    ) -> None:
        self.folder, self.described, self.models, self.state = folder, described, models, state
        self._watched = described.has_camera or state.is_pictured  # False if nobody saw the finished canvas
        self._plan: Plan | None = None
        self._first_expected: Tensor | None = None
        self._paints: tuple[BrushPaints, ...] = ()
        self.similarity = ""
        self._left_out = 0
        self._filming = True
        self._in_hand: Future[None] | None = None  # the timelapse frame in progress

    def __enter__(self) -> Self:
        self._sheets = RecipeSheets(self.folder, self.described.owned)
        self._thread = ThreadPoolExecutor(1, "film")  # encodes while the robot goes on painting
        self._film = FilmWriter(self.folder / "film.mp4", self.described.frames)
        if self.described.target is not None:
            images.save(self.described.target, self.folder / _TARGET)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._end_film()
        self._sheets.finish()

    def hear(self, event: Event) -> Event:
        """Keeps the pictures of an event; returns the event with their files, for the journal."""
        try:
            match event:
                case events.Planned():
                    return self._keep_plan(event)
                case events.SessionResumed(done, plan=Plan() as plan, expected=expected):
                    self._keep_on(done, plan, expected)
                case events.TimelapseFrame():
                    kept = replace(event, picture=keep_frame(self.folder, event.done, event.photograph))
                    shown = event.photograph, event.done / event.of, event.color
                    before, self._in_hand = self._in_hand, self._thread.submit(self._show, *shown)
                    if before is not None:
                        before.result()
                    return kept
                case events.Looked():
                    return self._keep_look(event)
        except StorageError:  # the painting is worth more than its pictures
            self._left_out += 1
        return event

    def finish(self, painting: Painting, printed: NDArray[np.uint8] | None = None) -> Path | None:
        """Closes the film, writes pictures, exports, figures and the page; returns the page's path.

        printed [rows, columns, 3]: the canvas in more detail than its photograph; None if there is only that
        Returns None if the work was stopped before there was a plan: then there is nothing to tell. Raises
        StorageError.
        """
        self._end_film()
        if self._plan is not None and not self.described.is_mixed:
            self._sheets.renew(self._plan)
        self._paints, left_out = self._sheets.finish()
        self._left_out += left_out
        if self._plan is None or self._first_expected is None:
            return None
        painted = self._plan.part(slice(painting.painted))
        widths = _plan_widths(painted, self.models)
        storage.write_text(self.folder / "strokes.svg", _draw_svg(painted, widths))
        storage.write_text(self.folder / "strokes.csv", _write_table(painted))
        images.save(painting.photograph, self.folder / _CANVAS)
        size = self._keep_painting(painting.photograph, printed)
        comparisons = self._compare(painting.photograph, self._first_expected)
        self._keep_card(images.to_uint8(painting.photograph) if printed is None else printed, painting, comparisons)
        self.similarity = next((str(one) for one in comparisons if one.label.startswith("The painting")), "")
        story = {
            "described": self.described,
            "state": self.state,
            "plan": self._plan,
            "painting": painting,
            "paints": self._paints,
            "supplies": supplies(self._paints),
            "looks": self._looks(),
            "comparisons": comparisons,
            "watched": self._watched,
            "size": size,
            "left_out": self._left_out,
            "has_film": (self.folder / "film.mp4").exists(),
            "has_card": (self.folder / _CARD).exists(),
            "arm_film": ARM_FILM if (self.folder / ARM_FILM).exists() else "",
        }
        page = _write_page(story, self.folder)
        self._write_result(self._plan, painting, comparisons)
        return page

    def _keep_painting(self, photograph: Tensor, printed: NDArray[np.uint8] | None) -> tuple[int, int]:
        """Writes the painting, in all its detail if there is room; returns its columns and rows."""
        path = self.folder / _PAINTING
        try:
            if printed is not None:
                images.save_exactly(printed, path)
                return printed.shape[1], printed.shape[0]
        except StorageError:
            self._left_out += 1
        storage.copy(self.folder / _CANVAS, path, "a picture of the canvas", storage.MAX_BYTES)
        return photograph.shape[2], photograph.shape[1]

    def _keep_card(
        self, painted: NDArray[np.uint8], painting: Painting, comparisons: tuple[PictureComparison, ...]
    ) -> None:
        """Writes the card with the photograph, if there is one, and the painting [rows, columns, 3]."""
        target, last = self.described.target, self.state.sittings.last
        near = [one.words for one in comparisons if target is not None and one.label == _NEARNESS]
        done = count_of(painting.painted, "stroke")
        day = [] if last is None else [f"{last.astimezone():%d %B %Y}".lstrip("0")]
        try:
            pictures = [*([] if target is None else [images.to_uint8(target)]), painted]
            images.save(card(pictures, self.described.title, "   ·   ".join([*day, done, *near])), self.folder / _CARD)
        except StorageError:
            self._left_out += 1

    def _keep_plan(self, event: events.Planned) -> events.Planned:
        """Stores the whole plan: the painted strokes, then the remaining ones; returns the event with its picture."""
        if self._plan is None or event.done == 0:  # a plan for the measured paints replaces the first one
            self._plan, self._first_expected = event.plan, event.expected
            images.save(event.expected, self.folder / "plan.png")
            if self.described.is_mixed:
                self._sheets.renew(event.plan)
            return event
        before, self._plan = self._plan, self._plan.part(slice(event.done)).followed_by(event.plan)
        if self.described.is_mixed and not torch.equal(before.palette.color, self._plan.palette.color):
            self._sheets.renew(self._plan, before.palette)  # new paints for the next layer
        look = self.state.pictures.looks[-1] if self.state.pictures.looks else None
        if look is None or look.done != event.done or look.planned is not None or not look.pictures:
            return event
        name = look.pictures["seen"].replace("photograph", "plan")
        images.save(event.expected, self.folder / name)
        return replace(event, look=name)

    def _keep_look(self, event: events.Looked) -> events.Looked:
        number = storage.next_number(self.folder, "look-")
        rows, columns = event.expected.shape[1:]
        files = {"seen": "photograph", "expected": "expected", "difference": "difference"}
        names = {part: f"look-{number}-{file}.jpg" for part, file in files.items()}
        shown = difference(event.expected, images.fit(event.photograph, rows, columns))
        for name, picture in zip(names.values(), (event.photograph, event.expected, shown), strict=True):
            images.save(picture, self.folder / name)
        return replace(event, pictures=names)

    def _keep_on(self, done: int, plan: Plan, expected: Tensor | None) -> None:
        """Continues the film of an earlier sitting."""
        self._plan = plan
        if self.described.is_mixed:
            self._sheets.renew(plan)
        try:
            self._first_expected = images.load(self.folder / "plan.png")
        except ImageError:
            self._first_expected = expected
        for stroke, picture in kept_frames(self.folder, done):
            red, green, blue = plan.strokes.color[stroke - 1].tolist()
            self._show(picture, stroke / len(plan), (red, green, blue))

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

    def _show(self, picture: NDArray[np.uint8], done: float, color: tuple[float, float, float]) -> None:
        """Adds a picture at a share of the strokes to the film, unless an earlier write failed."""
        if self._filming:
            try:
                self._film.add(picture, done, color)
            except StorageError:
                self._filming = False
                raise

    def _looks(self) -> list[tuple[LookState, events.Planned]]:
        """Returns the looks after which the rest was planned again, with the new plans."""
        return [(look, look.planned) for look in self.state.pictures.looks if look.planned and look.planned.look]

    def _compare(self, photograph: Tensor, first_expected: Tensor) -> tuple[PictureComparison, ...]:
        """Returns comparisons of plan, painting and, if there is one, target, as in their files, at the plan's size."""
        size, plan = first_expected.shape[1:], ("first plan", first_expected)
        painting = [("painting", photograph)] if self._watched else []  # else nobody knows how near it came
        target = [] if self.described.target is None else [("photograph", images.load(self.folder / _TARGET))]
        pairs = [(one, to) for to in target for one in (plan, *painting)] + [(one, plan) for one in painting]
        return tuple(compare(f"The {one} against the {other}", a, b, *size) for (one, a), (other, b) in pairs)

    def _write_result(self, plan: Plan, painting: Painting, comparisons: tuple[PictureComparison, ...]) -> None:
        state, expected = self.state, self.state.planning.expected_seconds
        storage.write_json(
            self.folder / _RESULT,
            {
                "format": "frida-painter result",
                "version": 1,
                "title": self.described.title,
                "stopped": state.end.stopped,
                "photographed": self._watched,
                "settings": self.described.settings,
                "goal_changes": [{"strokes": each.done, "goal": list(each.facts)} for each in state.wishes.goals],
                "strokes_planned": len(plan),
                "strokes_painted": painting.painted - len(state.progress.given_up),
                "dips": sum(state.brush.dips.values()),
                "cleanings": state.brush.cleanings,
                "seconds": round(state.sittings.seconds, 3),
                "sittings": state.sittings.count,
                "strokes_given_up": state.progress.given_up,
                "robot_seconds": round(painting.robot_seconds, 3),
                "robot_seconds_expected": round(expected, 3) if expected else None,
                "plan_digest": plan.digest,
                "palette": [paint.hex for paint in paints(plan)],
                "comparisons": [
                    {"what": one.label, "psnr_db": one.psnr, "lab_distance": one.distance, "pixels": one.size}
                    for one in comparisons
                ],
                "forecasts": [
                    {"strokes": done, **{name: round(psnr, 3) for name, psnr in zip(_FORECAST, found, strict=True)}}
                    for done, found in state.planning.forecasts
                ],
                "looks": [
                    {"strokes": look.done, "loss_before": planned.loss_before, "loss_after": planned.loss_after}
                    for look, planned in self._looks()
                ],
                "files": sorted({path.name for path in self.folder.iterdir() if path.name[0] != "."} | {_RESULT}),
            },
        )
