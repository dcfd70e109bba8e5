"""Paintings from the command line that are killed, and the command that goes on with them."""

import io
import json
import os
import shutil
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest
from PIL import Image

from frida_painter.session.fold import PaintingState
from frida_painter.strokes.plan import Plan
from frida_painter.system import storage
from frida_painter.system.event_log import EventLog
from frida_painter_cli import commands
from killing import began, kill_when
from support import data
from support.commandline import Command

STROKES = 10
SMALL = (
    "--canvas",
    "120x90mm",
    "--fit",
    "crop",
    "--render-height",
    "64",
    "--effort",
    "0.05",
    "--brush",
    "fine",
    "--colors",
    "3",
)
Resume = Callable[..., tuple[int, str]]


@pytest.fixture(scope="module")
def killed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a painting of ten strokes that was killed in its seventh."""
    place = tmp_path_factory.mktemp("killed")
    Image.fromarray(data.coffee()).resize((300, 200)).save(place / "coffee.jpg")
    words = ("paint", place / "coffee.jpg", "--strokes", STROKES, "--replans", 1, *SMALL, "--out", place / "painting")

    def paint() -> None:
        sys.argv = ["frida-painter", *map(str, words)]
        commands.main()

    kill_when(place / "painting" / "journal", began(7), paint)
    until = time.monotonic() + 60
    while (place / "painting" / ".studio.diary-reserve").exists() and time.monotonic() < until:
        time.sleep(0.1)  # the easel's process ends by itself
    (place / "coffee.jpg").unlink()
    return place / "painting"


@pytest.fixture
def painting(killed: Path, tmp_path: Path) -> Path:
    shutil.copytree(killed, tmp_path / "painting")
    return tmp_path / "painting"


@pytest.fixture
def resume(monkeypatch: pytest.MonkeyPatch, call: Command, painting: Path) -> Resume:
    """resume(word, ..., typed=): exit status, and all that was said; `typed` is what the person answers."""

    def resuming(*words: object, typed: str = "") -> tuple[int, str]:
        monkeypatch.setattr("sys.stdin", io.StringIO(typed))
        said = call("resume", *words)
        return said.status, said.out + said.err

    return resuming


def tensors_of(plan: Path) -> Path:
    """The file of strokes that a plan names; those of plans before it may lie beside it."""
    return plan.with_name(json.loads(plan.read_text())["tensors"])


def contents(folder: Path) -> dict[Path, bytes]:
    """Of all files but the journal's reserve, which a killed process leaves behind."""
    return {path: path.read_bytes() for path in folder.rglob("*") if path.is_file() and path.name[0] != "."}


def told(folder: Path) -> PaintingState:
    return PaintingState.of_journal(EventLog.read(folder / "journal"), folder)


def test_it_shows_what_was_done_and_does_nothing_by_itself(resume: Resume, painting: Path) -> None:
    before = contents(painting)
    status, said = resume("painting", typed="n\n")
    assert status == 2 and "Nothing was moved" in said
    assert "Coffee: 6 of 10 strokes on a canvas of 120 x 90 mm, painted in one sitting of" in said
    assert "Stroke 7 was begun, and nothing tells whether it was painted." in said
    assert "painting/photographs/look-0001.png" in said
    assert contents(painting) == before
    status, said = resume("painting")
    assert status == 2 and "Nobody answered" in said and "--yes" in said


def test_a_killed_painting_is_finished_and_its_story_is_whole(resume: Resume, painting: Path) -> None:
    status, said = resume("painting", typed="perhaps\ny\n\n")
    assert status == 0, said
    assert "Type y or n." in said and "paint stroke 7 again? [y/N]" in said and "10 strokes in " in said
    history = told(painting)
    assert history.end.finished and history.progress.given_up == [7] and history.sittings.count == 2
    result = json.loads((painting / "result.json").read_text())
    assert result["strokes_painted"] == 9 and result["sittings"] == 2 and result["strokes_given_up"] == [7]
    assert [look["strokes"] for look in result["looks"]] == [5] and result["settings"]["photo"] == "coffee.jpg"
    assert result["plan_digest"] == Plan.load(painting).digest
    assert set(result["files"]) == {path.name for path in painting.iterdir() if path.name[0] != "."}
    page = (painting / "index.html").read_text()
    assert "Strokes given up" in page and "film.mp4" in page and "look-1-photograph.jpg" in page
    status, said = resume("painting", "--yes")
    assert status == 0 and "This painting is finished: 10 strokes" in said
    assert not (painting / "strokes.gcode").exists()
    status, said = resume("painting", "--page", painting.parent)  # as if its painter had been killed in its results
    assert status == 0 and "made again" in said and (painting / "strokes.gcode").exists()


def test_in_scripts_the_stroke_in_doubt_is_painted_again_only_where_that_is_said(
    resume: Resume, painting: Path
) -> None:
    status, _ = resume("painting", "--yes", "--repaint")
    assert status == 0
    strokes = [one["done"] for one in EventLog.read(painting / "journal") if one["kind"] == "stroke_painted"]
    assert strokes == list(range(1, 11)) and told(painting).progress.given_up == []
    with Image.open(painting / "now.png") as picture:
        assert picture.width > picture.height > 700


def test_what_was_changed_is_shown_and_refused_until_it_is_accepted(resume: Resume, painting: Path) -> None:
    """Fault F33: the plan or the settings were changed before resuming."""
    settings = painting / "settings.json"
    settings.write_text(settings.read_text().replace('"effort": 0.05', '"effort": 0.06'))
    Image.new("RGB", (64, 64), "blue").save(painting / "goal" / "1" / "coffee.jpg")
    plan = Plan.load(painting)
    plan.part(slice(1, None)).followed_by(plan.part(slice(1))).save(painting / "plan.json")
    status, said = resume("painting", "--yes")
    assert status == 2 and "effort: it was 0.05, and is 0.06" in said and "goal: it was " in said
    assert f"plan: it was {plan.digest[:12]}, and is " in said and "--accept-changes" in said
    assert told(painting).sittings.count == 1
    status, said = resume("painting", "--yes", "--accept-changes")
    assert status == 0 and told(painting).end.finished


def test_what_is_painted_cannot_become_something_else(resume: Resume, painting: Path) -> None:
    """Fault F33: the plan or the settings were changed before resuming."""
    settings = painting / "settings.json"
    settings.write_text(settings.read_text().replace('"strokes": 10', '"strokes": 12'))
    status, said = resume("painting", "--yes", "--accept-changes")
    assert status == 2 and "strokes: it was 10, and is 12" in said and "strokes cannot be changed any more" in said


@pytest.mark.parametrize(
    ("spoil", "says"),
    [
        (lambda folder: shutil.rmtree(folder), "is not the folder of a painting"),
        (lambda folder: (folder / "journal").unlink(), "is not the folder of a painting"),
        (lambda folder: (folder / "settings.json").unlink(), "settings.json does not exist"),
        (lambda folder: (folder / "plan.json").write_text("{"), "plan.json is not a plan"),
        (lambda folder: tensors_of(folder / "plan.json").write_bytes(b"PK"), "is not the file that belongs to"),
        (lambda folder: (folder / "goal" / "goal.toml").unlink(), "goal: it was"),
        (lambda folder: (folder / "studio.diary").write_text("{}\n"), "studio.diary: its last"),
        (lambda folder: replaced(folder / "plan.json").symlink_to("/dev/zero"), "plan.json is not a plain file"),
        (lambda folder: os.mkfifo(replaced(folder / "journal")), "journal is not a plain file"),
        (lambda folder: change_middle(folder / "journal"), "was changed after it was written"),
    ],
)
def test_what_is_no_painting_any_more_is_refused_with_a_sentence(
    resume: Resume, painting: Path, spoil: Callable[[Path], object], says: str
) -> None:
    spoil(painting)
    status, said = resume("painting", "--yes")
    assert status == 2 and says in said.replace("\n", " ") and "Traceback" not in said
    assert len(said.splitlines()) < 12


def replaced(path: Path) -> Path:
    path.unlink()
    return path


def shorten(path: Path, lines: int) -> None:
    path.write_bytes(b"".join(path.read_bytes().splitlines(keepends=True)[:-lines]))


@pytest.mark.parametrize(
    ("name", "lines", "says"),
    [
        ("journal", 1, "journal: its last record is gone, and their strokes would be painted again"),
        ("journal", 9, "journal: its last 9 records are gone"),
        ("studio.diary", 20, "studio.diary: its last 1"),
    ],
)
def test_a_log_that_was_shortened_is_not_believed(
    resume: Resume, painting: Path, name: str, lines: int, says: str
) -> None:
    """B4, B7: whole lines missing at the end leave a log that is whole in itself; another file tells of them."""
    shorten(painting / name, lines)
    before = contents(painting)
    status, said = resume("painting", "--yes")
    assert status == 2 and says in said and "--accept-changes" in said, said
    assert contents(painting) == before, "nothing was painted"


def test_results_are_made_again_from_what_the_folder_holds(resume: Resume, painting: Path) -> None:
    """B3: a painting that was killed while its page was written is finished all the same."""
    assert resume("painting", "--yes")[0] == 0
    before = contents(painting)
    for name in ("painting.png", "index.html", "result.json", "film.mp4"):
        (painting / name).unlink()
    (left := painting / f"{storage.PART}abcd1234.mp4").write_bytes(b"half a film, of a process that was killed")
    (own := painting / ".film-abcd1234.mp4").write_bytes(b"somebody's own")
    motions = (painting / "studio.diary").read_bytes()
    status, said = resume("painting", "--yes")
    assert status == 0 and "made again" in said, said
    assert (painting / "painting.png").read_bytes() == before[painting / "painting.png"]
    assert (painting / "film.mp4").stat().st_size > 0.9 * len(before[painting / "film.mp4"])
    assert not left.exists() and own.exists()
    first, again = json.loads(before[painting / "result.json"]), json.loads((painting / "result.json").read_text())
    same = ("strokes_painted", "sittings", "looks", "files", "robot_seconds", "robot_seconds_expected", "dips")
    assert [again[name] for name in same] == [first[name] for name in same]
    assert (painting / "studio.diary").read_bytes() == motions, "nothing was moved"
    assert "nothing is left to do" in resume("painting", "--yes")[1]


def change_middle(path: Path) -> None:
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 1
    path.write_bytes(content)


def test_a_painting_that_another_process_works_on_is_left_to_it(resume: Resume, painting: Path) -> None:
    with EventLog(painting / "journal"):
        status, said = resume("painting", "--yes")
    assert status == 2 and "being written by" in said
