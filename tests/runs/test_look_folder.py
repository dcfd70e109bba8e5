"""Pictures that a person takes of a painting without a camera, in the folder `looks` or by `frida-painter look`."""

import os
import time
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np
import pytest
import torch
from PIL import Image

from frida_painter.runs.look_folder import GivenPicture, LookFolder
from frida_painter.runs.run import PaintingRun
from frida_painter.runs.spec import RunSpec
from frida_painter.session.controls import Controls
from frida_painter.session.events import PauseCause, Paused, Planned, Remark
from frida_painter.session.fold import PaintingState
from frida_painter.system.event_log import EventLog
from marks import coarse_table
from support import data
from support.commandline import run_command
from support.telephone import taken

TRUE_PHOTOGRAPHS = True

STROKES, PAUSED = 12, 6


def put(picture: np.ndarray, path: Path, when: float | None = None) -> None:
    """Saves a picture as a telephone does; `when` it was taken, seconds since 1970."""
    path.parent.mkdir(exist_ok=True)
    exif = Image.Exif()
    if when is not None:
        local = time.strftime("%Y:%m:%d %H:%M:%S", time.gmtime(when))
        exif.get_ifd(0x8769).update({0x9003: local, 0x9011: "+00:00"})
    Image.fromarray(picture).save(path, exif=exif, quality=92)
    os.utime(path, (time.time() - 5,) * 2)  # it is written no more


def told(folder: Path) -> PaintingState:
    return PaintingState.of_journal(EventLog.read(folder / "journal"), folder)


@pytest.fixture
def spec(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> RunSpec:
    monkeypatch.setattr("frida_painter.planning.materials.cached_table", coarse_table)
    monkeypatch.chdir(tmp_path)
    Image.fromarray(data.coffee()).resize((140, 100)).save("coffee.png")
    return RunSpec.of(
        goal=[{"image": "coffee.png"}], strokes=STROKES, colors=2, brush="medium", render_height=64, effort=0.05,
        layers=1, camera="none", canvas="280x200mm", ground="white",
    )  # fmt: skip


def test_a_picture_in_the_folder_counts_as_a_look_and_one_of_another_canvas_is_refused(
    tmp_path: Path, spec: RunSpec, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    folder, heard, paused = tmp_path / "it", [], []

    def cause() -> PauseCause | None:
        done = run.session is not None and run.session.so_far is not None and run.session.so_far.painted
        return "person" if done == PAUSED and not paused else None

    def go_on(why: Paused) -> bool:
        paused.append(why)
        assert run.session is not None and run.session.open_loop is not None
        canvas = run.session.open_loop.expect(PAUSED)
        other = torch.flip(canvas, (2,))  # the same paints in other places
        put(taken(other, 1)[0], folder / "looks" / "a-other.jpg")
        (folder / "looks" / "b-broken.jpg").write_bytes(b"\xff\xd8\xff\xe0 no picture")
        os.utime(folder / "looks" / "b-broken.jpg", (time.time() - 4,) * 2)
        put(taken(canvas, 2)[0], folder / "looks" / "c-this.jpg")
        monkeypatch.setattr("frida_painter.runs.look_folder._BETWEEN", 0.0)
        return True

    with PaintingRun(spec, folder, controls=Controls(pause_cause=cause, go_on=go_on)) as run:
        run.listeners.append(heard.append)
        outcome = run.start()
    assert outcome.trouble is None and outcome.painting is not None and outcome.painting.painted == STROKES
    assert sorted(path.name for path in (folder / "looks").rglob("*.jpg")) == [
        "a-other.jpg",
        "b-broken.jpg",
        "c-this.jpg",
    ]
    assert (folder / "looks" / "used" / "c-this.jpg").exists() and (
        folder / "looks" / "refused" / "a-other.jpg"
    ).exists()
    remarks = [event.sentence for event in heard if isinstance(event, Remark)]
    assert len(remarks) == 2 and "a-other.jpg does not count as a look" in remarks[0] and "b-broken.jpg" in remarks[1]
    history = told(folder)
    assert history.end.finished and history.pictures.count == 1 and PAUSED <= history.pictures.pictured <= PAUSED + 2
    plans = [event for event in heard if isinstance(event, Planned)]
    assert [planned.done for planned in plans][-1] == history.pictures.pictured, "the rest was planned again from it"
    page = (folder / "index.html").read_text()
    assert "it looked at the pictures that a person took" in page and "nobody photographed it" in page

    # The finished painting gets a person's picture by the command.
    final = taken(
        torch.from_numpy(np.asarray(Image.open(folder / "painting.png")) / 255).permute(2, 0, 1).float(), 3, 1
    )
    put(final[0], tmp_path / "final.jpg")
    for words, status, says in (
        (("look", "it", "coffee.png", "--yes"), 2, "cannot be told from what is around it"),
        (("look", "it", "final.jpg", "--corners", "1,2 3"), 2, "--corners was given '1,2 3'"),
        (("look", "it", "final.jpg", "--yes"), 0, "The painting"),
    ):
        ended = run_command(*words)
        said = " ".join("".join(capsys.readouterr()).split())
        assert ended == status and says in said, said
    page = (folder / "index.html").read_text()
    assert "photographed by a person" in page and "nobody photographed it" not in page
    assert told(folder).pictures.pictured == STROKES


@pytest.mark.parametrize(("seconds", "done"), [(-5, 0), (5, 1), (15, 2), (500, 3), (None, 3)])
def test_a_dated_picture_shows_the_strokes_that_were_painted_by_then(
    tmp_path: Path, seconds: float | None, done: int
) -> None:
    began = datetime(2026, 11, 25, 10, tzinfo=UTC)
    journal = EventLog.begin(
        tmp_path / "journal", {"kind": "painting_begun", "at": began.isoformat(), "settings": {}, "rests_on": {}}
    )
    for number in (1, 2, 3):
        at = (began + timedelta(seconds=10 * (number - 1))).isoformat()
        journal.append({"kind": "stroke_painted", "at": at, "done": number})
    journal.close()
    when = None if seconds is None else began.timestamp() + seconds
    put(np.zeros((40, 60, 3), np.uint8), tmp_path / "mine.jpg", when)
    assert GivenPicture(tmp_path / "mine.jpg").count_strokes(tmp_path / "journal", 3) == done


def test_corners_that_a_person_pointed_at_go_with_the_picture(tmp_path: Path) -> None:
    put(np.zeros((40, 60, 3), np.uint8), tmp_path / "mine.jpg")
    corners = ((1.0, 2.0), (50.0, 2.0), (50.0, 30.0), (1.0, 30.0))
    looks = LookFolder(tmp_path)
    copy = looks.put(tmp_path / "mine.jpg", corners)
    os.utime(copy, (time.time() - 5,) * 2)
    given = looks.take_next()
    assert given is not None and given.corners == corners and given.load().shape == (40, 60, 3)
    assert looks.take_next() is None, "it looks every half second at most"
    looks.file_away(given, "used")
    assert not list(looks.path.glob("*.*")) and len(list((looks.path / "used").iterdir())) == 2
