"""Records of plans and paintings: they say whether something can be made again, and what has changed."""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

import frida_painter as fp
from frida_painter.errors import StorageError
from frida_painter.runs.painting_folder import RecordCheck, RunRecord, hash_files
from frida_painter.system import storage
from support.belongings import files_of_a_person
from support.commandline import run_command
from support.planning import picture

SAME = "It can be made again here: nothing that decides it has changed."


@pytest.fixture
def begun(tmp_path: Path) -> RunRecord:
    """The record of a plan that need not be planned."""
    folder = tmp_path / "plan"
    (folder / "goal" / "1").mkdir(parents=True)
    fp.save_picture(picture(), folder / "goal" / "1" / "a.png")
    (folder / "goal" / "goal.toml").write_text('[[goal]]\nimage = "1/a.png"\n')
    spec = fp.RunSpec.of(goal=[{"image": str(folder / "goal" / "1" / "a.png")}], strokes=3, render_height=64)
    made = RunRecord.begin(folder, "painting", spec, ("broad",), "cpu")
    made.finish(painting="0" * 64)
    return RunRecord.load(folder)


def test_nothing_changed(begun: RunRecord) -> None:
    checked = begun.check()
    assert checked == RecordCheck() and checked.can_be_made_again and checked.passed and str(checked) == SAME
    assert set(begun.inputs) == {"goal/1/a.png", "goal/goal.toml", "weights of broad"}


RESULTS = (
    "index.html", "painting.png", "film.mp4", "arm.mp4", ".arm/000000.mp4", "palette.png", "palette-layer-2.png",
    "mixing.png", "shopping.txt", "plan.png", "now.png", "target.jpg", "look-1-plan.jpg", "painters.csv", "strokes.svg",
    "strokes.csv", "strokes.gcode", "result.json", "settings.json", "plan.json", "plan-0123456789ab.safetensors",
    "calibration.json",
    "journal", ".journal-tally", "studio.diary", ".studio.diary-tally", "changes/1/goal/goal.toml",
    "changes/1/goal/1/b.png", "regions/1.png", "photographs/look-0000.png", "sketchbook/story.json",
)  # fmt: skip


@pytest.fixture
def painted(begun: RunRecord) -> RunRecord:
    """The record of a folder with every kind of file, and those of a person between them."""
    for name in RESULTS:
        storage.write_text(begun.folder / name, f"the content of {name}")
    files_of_a_person(begun.folder / "looks")
    (begun.folder / "notes.txt").write_text("mine")
    begun.finish(painting="0" * 64)
    return RunRecord.load(begun.folder)


def flip(path: Path) -> None:
    path.write_bytes(bytes([path.read_bytes()[0] ^ 1]) + path.read_bytes()[1:])


def make_a_folder(path: Path) -> None:
    path.unlink()
    path.mkdir()


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (flip, "was changed"),
        (lambda path: path.write_bytes(path.read_bytes()[:-1]), "was changed"),
        (lambda path: path.write_bytes(b""), "was changed"),
        (Path.unlink, "is missing"),
        (make_a_folder, "is missing"),
    ],
)
def test_each_change_of_each_file_is_named(painted: RunRecord, change: Callable[[Path], object], said: str) -> None:
    assert painted.check() == RecordCheck() and painted.check().passed
    for name in RESULTS:
        change(painted.folder / name)
    checked = fp.record(painted.folder).check()
    assert sorted(checked.files) == sorted(f"{name} {said}" for name in RESULTS)
    assert not checked.passed and all(one in str(checked) for one in checked.files)
    assert fp.record(painted.folder).make_again() == checked, "what was edited is not made again"


def test_what_a_person_adds_is_theirs_and_what_lies_among_results_is_named(painted: RunRecord) -> None:
    for name in ("my.txt", "looks/used/my.jpg", ".git/config", "pause", "stop", ".camera.jpg", "mine/painting.png"):
        storage.write_text(painted.folder / name, "")
    assert painted.check().passed
    for name in ("look-9-plan.jpg", "goal/2/a.png", "photographs/look-0009.png", "mixing-layer-3.png"):
        storage.write_text(painted.folder / name, "")
    assert len(painted.check().files) == 4 and all(one.endswith(" was added") for one in painted.check().files)


def test_results_that_are_made_again_do_not_hide_an_edit(painted: RunRecord) -> None:
    for name in ("journal", "strokes.svg", "painting.png", "look-7-plan.jpg"):
        storage.write_text(painted.folder / name, "edited")
    (painted.folder / "settings.json").unlink()
    before = hash_files(painted.folder)
    for name in ("painting.png", "film.mp4", "now.png"):
        storage.write_text(painted.folder / name, "made again")
    painted.finish(before=before, **painted.results)
    assert RunRecord.load(painted.folder).check().files == (
        "journal was changed", "look-7-plan.jpg was added", "settings.json is missing", "strokes.svg was changed",
    )  # fmt: skip


def test_a_record_without_hashes_of_files_says_so(painted: RunRecord) -> None:
    kept = json.loads((painted.folder / "record.json").read_text())
    storage.write_json(painted.folder / "record.json", {name: value for name, value in kept.items() if name != "files"})
    older = RunRecord.load(painted.folder)
    assert older.results == painted.results and older.check().remark in str(older.check()) != SAME


def test_all_files_of_a_painting_are_known_and_stay_known_when_results_are_made_again(tmp_path: Path) -> None:
    fp.save_picture(picture(), tmp_path / "a.png")
    folder = tmp_path / "it"
    fp.paint(tmp_path / "a.png", folder=folder, canvas="12x9cm", strokes=4, replans=1, render_height=64)
    found = fp.record(folder)
    there = {path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file()}
    assert there == {*found.files, "record.json"} and found.check() == RecordCheck()
    flip(folder / "photographs" / "look-0001.png")
    (folder / "film.mp4").unlink()
    with fp.PaintingRun.reopen(folder) as run:
        run.resume()
    checked = fp.record(folder).check()
    assert checked.files == ("photographs/look-0001.png was changed",) and not checked.obstacle
    flip(folder / "photographs" / "look-0001.png")
    assert fp.record(folder).make_again() == RecordCheck(same=True)


def test_what_has_changed_is_named(begun: RunRecord) -> None:
    fp.save_picture(picture() * 0.5, begun.folder / "goal" / "1" / "a.png")
    (begun.folder / "goal" / "goal.toml").unlink()
    older = replace(begun, made_with={**begun.made_with, "torch": "1.0", "plug-in calm": "2 code x"})
    checked = older.check()
    assert not checked.passed
    said = str(checked)
    for part in ("torch was 1.0 and is ", "plug-in calm was 2 code x and is missing here", "goal/1/a.png has changed",
                 "goal/goal.toml is gone"):  # fmt: skip
        assert part in said


def test_what_was_not_finished_or_is_no_program_s_work_is_said(begun: RunRecord) -> None:
    assert "never finished" in str(replace(begun, results={}).check())
    replace(begun, obstacle="A person led it.").save()
    checked = fp.record(begun.folder).make_again()
    assert checked.obstacle == "A person led it." and str(checked) == f"{checked.obstacle} {checked.remark}"


@pytest.mark.parametrize("damage", ["cut", "edited", "emptied", "foreign"])
def test_a_damaged_record_is_refused_in_one_sentence(begun: RunRecord, damage: str) -> None:
    path = begun.folder / "record.json"
    text = path.read_text()
    kept = json.loads(text)
    path.write_text({
        "cut": text[: len(text) // 2], "edited": text.replace("0" * 64, "1" * 64), "emptied": "",
        "foreign": json.dumps({**kept, "format": "x"}),
    }[damage])  # fmt: skip
    with pytest.raises(StorageError) as refused:
        fp.record(begun.folder)
    assert "record.json" in str(refused.value) and "\n" not in str(refused.value)


def test_a_plan_is_made_again_to_the_last_bit(tmp_path: Path) -> None:
    fp.save_picture(picture(), tmp_path / "a.png")
    spec = fp.RunSpec.of(goal=[{"image": str(tmp_path / "a.png")}], canvas="12x9cm", strokes=3, render_height=64,
                         focus="none")  # fmt: skip
    with fp.PaintingRun(spec) as run:
        plan = run.plan()
        run.plan_into(tmp_path / "plan", plan)
    facts = dict(fp.Plan.load(tmp_path / "plan").about)
    assert "torch" in facts["made with"] and len(facts["weights of broad"]) == 16
    found = fp.record(tmp_path / "plan")
    assert str(found.make_again()) == "It was made again, and is the same to the last bit."
    plan.edit(angle=0.0).save(tmp_path / "plan" / "plan.json")
    checked = fp.record(tmp_path / "plan").make_again()
    assert not checked.passed and checked.same is None and checked.files[-1] == "plan.json was changed"


def test_the_command_says_it_with_its_exit_status(begun: RunRecord, capsys: pytest.CaptureFixture[str]) -> None:
    assert run_command("verify", str(begun.folder)) == 0 and capsys.readouterr().out.strip() == SAME
    (begun.folder / "goal" / "1" / "a.png").unlink()
    assert run_command("verify", str(begun.folder)) == 1 and "a.png is gone" in capsys.readouterr().out
