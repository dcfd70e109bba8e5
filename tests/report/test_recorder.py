import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from numpy.typing import NDArray
from torch import Tensor

from frida_painter.errors import StorageError
from frida_painter.planning.mixable import MIXED_PAINTS
from frida_painter.report.recorder import Description, Recorder
from frida_painter.session.events import (
    Dipped,
    Event,
    Looked,
    Planned,
    PlanningStep,
    Remark,
    Stopped,
    StrokePainted,
    TimelapseFrame,
)
from frida_painter.session.fold import PaintingState
from frida_painter.session.journal import Journal
from frida_painter.session.progress import Painting
from frida_painter.strokes.plan import Plan
from frida_painter.system import images
from support.planning import small_table
from support.plans import CANVAS, LIMITS, made_up_plan

TOLD = ("A cup <of> coffee", torch.full((3, 60, 90), 0.4), (("Seed", "7"),), {"photo": "cup.jpg", "strokes": 12})
BLACK = (0.0, 0.0, 0.0)
FORECAST = (24.1, 23.6, 24.5)
SHEETS = {"palette.png", "mixing.png", "shopping.png", "shopping.txt"}


def picture(shade: float, rows: int = 40, columns: int = 60) -> Tensor:
    return torch.full((3, rows, columns), shade)


def frame(done: int) -> NDArray[np.uint8]:
    return images.to_uint8(picture(0.9 - 0.05 * done, 54, 80))


def moved(plan: Plan) -> Plan:
    """The plan made again: the same paints, other places."""
    strokes = plan.strokes.with_groups(position=plan.strokes.position * 0.9 + 0.01).project(LIMITS, CANVAS)
    return Plan.of(strokes, plan.palette, plan.paint, canvas=CANVAS, brush="medium", limits=LIMITS)


FIRST = made_up_plan(12, 3)
SECOND = moved(FIRST.part(slice(6, None)))


def an_evening() -> list[Event]:
    """12 strokes, planned again after 6; two dips, one with a cleaning; four timelapse frames."""
    events: list[Event] = [PlanningStep("plan", 1, 2, 0.5), PlanningStep("plan", 2, 2, 0.4)]
    events += [Planned(0, 12, 0.6, 0.3, FORECAST, plan=FIRST, expected=picture(0.5)), Dipped(0, False)]
    for done in range(1, 7):
        events.append(StrokePainted(done, 12, BLACK))
        if done % 3 == 0:
            events.append(TimelapseFrame(done, 12, BLACK, photograph=frame(done)))
    events += [Looked(6, photograph=picture(0.7, 80, 120), expected=picture(0.6)), PlanningStep("replan", 1, 1, 0.35)]
    events += [Planned(6, 6, 0.4, 0.3, plan=SECOND, expected=picture(0.5)), Dipped(1, True)]
    for done in range(7, 13):
        events.append(StrokePainted(done, 12, BLACK))
        if done % 3 == 0:
            events.append(TimelapseFrame(done, 12, BLACK, photograph=frame(done)))
    return [*events, Looked(12, photograph=picture(0.4, 80, 120), expected=picture(0.45))]


def recorded(
    folder: Path, events: list[Event], painting: Painting, timelapse_frames: int = 4
) -> tuple[Path | None, dict[str, object]]:
    folder.joinpath("plan.json").write_text("written by the journal")
    journal = Journal(None)
    with Recorder(folder, Description(*TOLD, timelapse_frames), {"medium": small_table()}, journal.state) as recorder:
        for event in events:
            journal.tell(recorder.hear(event))
        page = recorder.finish(painting)
    result = folder / "result.json"
    return page, json.loads(result.read_text()) if result.exists() else {}


def whole() -> Painting:
    return Painting(picture(0.42, 80, 120), 12, SECOND.part(slice(6, None)))


def named(page: str) -> set[str]:
    """The files that a page names."""
    return {name for name in re.findall(r'(?:src|href|poster)="([^"]+)"', page) if not name.startswith(("#", "data:"))}


def test_everything_that_was_promised_is_in_the_folder_and_the_page_names_only_what_is_there(tmp_path: Path) -> None:
    page, result = recorded(tmp_path, an_evening(), whole())
    assert page == tmp_path / "index.html"
    there = {path.name for path in tmp_path.iterdir()}
    looks = {f"look-1-{name}.jpg" for name in ("photograph", "expected", "difference", "plan")}
    promised = {
        "target.jpg",
        "plan.png",
        *SHEETS,
        "painting.png",
        "canvas.png",
        "card.jpg",
        "film.mp4",
        "plan.json",
        "index.html",
    }
    looks |= {f"look-2-{name}.jpg" for name in ("photograph", "expected", "difference")}  # the last look
    assert there == promised | looks | {"strokes.svg", "strokes.csv", "result.json", "sketchbook"}
    names = named(page.read_text())
    assert names <= there
    assert {"painting.png", "target.jpg", "film.mp4", "palette.png", "look-1-plan.jpg"} <= names
    assert set(result["files"]) == there  # type: ignore[call-overload]
    assert "12 strokes in 3 paints" in page.read_text() and "1 look in between" in page.read_text()
    assert "A cup &lt;of&gt; coffee" in page.read_text() and "300 x 200 mm" in page.read_text()
    assert all(path.stat().st_size > 50 for path in tmp_path.iterdir() if path.name != "plan.json")


def test_a_print_is_the_painting_and_the_look_stays_what_is_measured(tmp_path: Path) -> None:
    printed = np.random.default_rng(1).integers(0, 255, (300, 450, 3), np.uint8)
    journal = Journal(None)
    with Recorder(tmp_path, Description(*TOLD, 4), {"medium": small_table()}, journal.state) as recorder:
        for event in an_evening():
            journal.tell(recorder.hear(event))
        page = recorder.finish(whole(), printed)
    assert (images.load_exactly(tmp_path / "painting.png") == printed).all()
    assert images.load(tmp_path / "canvas.png").shape == (3, 80, 120)
    assert page is not None and "450 x 300 pixels" in page.read_text()
    without = tmp_path / "without"
    without.mkdir()
    assert recorded(without, an_evening(), whole())[1]["comparisons"] == read_json(tmp_path)["comparisons"]
    assert (without / "painting.png").read_bytes() == (without / "canvas.png").read_bytes()


def test_a_painting_without_room_for_its_print_is_complete_and_says_so(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(pixels: np.ndarray, path: Path) -> None:
        raise StorageError("No space is left.")

    monkeypatch.setattr("frida_painter.system.images.save_exactly", full)
    journal = Journal(None)
    with Recorder(tmp_path, Description(*TOLD, 4), {"medium": small_table()}, journal.state) as recorder:
        for event in an_evening():
            journal.tell(recorder.hear(event))
        page = recorder.finish(whole(), np.zeros((300, 450, 3), np.uint8))
    assert images.load(tmp_path / "painting.png").shape == (3, 80, 120)
    assert page is not None and "1, for want of space on the disk" in page.read_text()


def read_json(folder: Path) -> dict[str, object]:
    found: dict[str, object] = json.loads((folder / "result.json").read_text())
    return found


def test_colors_that_were_changed_so_that_they_can_be_mixed_are_told(tmp_path: Path) -> None:
    told = (f"{MIXED_PAINTS}, layer 1", "#ff00ff (15.2 off) became #b04090")
    changed = replace(SECOND, about=(told,))
    events = [
        replace(event, plan=changed) if isinstance(event, Planned) and event.done == 6 else event
        for event in an_evening()
    ]
    page, _ = recorded(tmp_path, events, whole())
    assert page is not None and all(words in page.read_text() for words in told)


def test_the_figures_are_those_of_the_evening(tmp_path: Path) -> None:
    _, result = recorded(tmp_path, an_evening(), whole())
    wanted = {
        "format": "frida-painter result",
        "stopped": False,
        "strokes_planned": 12,
        "strokes_painted": 12,
        "dips": 2,
        "cleanings": 1,
        "settings": {"photo": "cup.jpg", "strokes": 12},
        "forecasts": [
            {"strokes": 0, "expected_psnr_db": 24.1, "least_psnr_db": 23.6, "most_psnr_db": 24.5},
        ],
        "looks": [{"strokes": 6, "loss_before": 0.4, "loss_after": 0.3}],
    }
    assert {name: result[name] for name in wanted} == wanted
    assert "24.1 dB expected, 23.6 to 24.5" in (tmp_path / "index.html").read_text()
    plan, painting, between = result["comparisons"]  # type: ignore[misc]
    assert plan["psnr_db"] == pytest.approx(19.83, abs=0.01), "128 against 102 of 255"
    assert painting["psnr_db"] == pytest.approx(34.15, abs=0.01), "107 against 102"
    assert between["psnr_db"] == pytest.approx(21.69, abs=0.01), "107 against 128"


def test_the_plan_on_record_is_what_was_painted(tmp_path: Path) -> None:
    evening = an_evening()
    evening[-1:-1] = [Remark(f"{lower} mm lower", "touch", "medium") for lower in (0.5, 1.2)]
    page, result = recorded(tmp_path, evening, whole())
    assert page is not None and "1.2 mm lower" in page.read_text() and "0.5 mm" not in page.read_text()
    assert result["plan_digest"] == FIRST.part(slice(6)).followed_by(SECOND).digest


def test_what_is_to_be_said_of_the_last_photograph_is_on_the_page(tmp_path: Path) -> None:
    page, result = recorded(tmp_path, an_evening(), replace(whole(), remark="The last photograph is blurred."))
    assert page is not None and "The last photograph is blurred." in page.read_text()
    assert result["stopped"] is False


def test_a_painting_that_was_stopped_tells_what_there_is(tmp_path: Path) -> None:
    events = [*an_evening()[:8], Stopped()]
    page, result = recorded(tmp_path, events, Painting(picture(0.8, 80, 120), 4, FIRST.part(slice(4, None))))
    assert page is not None and result["stopped"] is True
    assert (result["strokes_painted"], result["strokes_planned"], result["looks"]) == (4, 12, [])
    assert named(page.read_text()) <= {path.name for path in tmp_path.iterdir()}
    assert len((tmp_path / "strokes.csv").read_text().splitlines()) == 5
    assert result["plan_digest"] == FIRST.digest


def test_without_a_plan_there_is_nothing_to_tell(tmp_path: Path) -> None:
    page, result = recorded(tmp_path, [PlanningStep("plan", 1, 2, 0.5), Stopped()], Painting(picture(1.0), 0, None))
    assert page is None and result == {}
    assert {path.name for path in tmp_path.iterdir()} <= {"target.jpg", "plan.json"}


def test_without_glimpses_there_is_no_film_and_the_page_does_not_name_one(tmp_path: Path) -> None:
    events = [event for event in an_evening() if not isinstance(event, TimelapseFrame)]
    page, _ = recorded(tmp_path, events, whole(), timelapse_frames=0)
    assert page is not None and not (tmp_path / "film.mp4").exists()
    assert "film.mp4" not in page.read_text()


def test_an_evening_that_ends_in_an_error_leaves_the_film_so_far(tmp_path: Path) -> None:
    def until_it_fails() -> None:
        with Recorder(tmp_path, Description(*TOLD, 4), {"medium": small_table()}, PaintingState()) as recorder:
            for event in an_evening()[:8]:
                recorder.hear(event)
            raise RuntimeError("the robot caught fire")

    with pytest.raises(RuntimeError, match="caught fire"):
        until_it_fails()
    left = {
        "target.jpg",
        "plan.png",
        *SHEETS,
        "film.mp4",
        "sketchbook",
    }
    assert {path.name for path in tmp_path.iterdir()} == left
