"""Records of plans and paintings: they say whether something can be made again, and what has changed."""

import json
from dataclasses import replace
from pathlib import Path

import pytest

import frida_painter as fp
from frida_painter.cli import commands
from frida_painter.errors import ConfigError, StorageError
from frida_painter.runs.run_record import RecordCheck, RunRecord
from support.planning import picture

OLDER = Path(__file__).parents[1] / "older"
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


def test_a_folder_that_was_moved_is_the_same(begun: RunRecord, tmp_path: Path) -> None:
    begun.folder.rename(tmp_path / "elsewhere")
    assert RunRecord.load(tmp_path / "elsewhere").check().passed


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
    assert str(fp.record(begun.folder).make_again()) == "A person led it."


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


def test_older_folders_are_read_and_their_lack_is_said(tmp_path: Path) -> None:
    for folder in ("plan", "painting"):
        checked = fp.record(OLDER / folder).check()
        assert not checked.passed and "kept no record of how" in str(checked)
    with pytest.raises(ConfigError, match="holds no plan, painting or sweep"):
        fp.record(tmp_path)


@pytest.mark.slow
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
    assert "plan.json in its folder was changed" in str(fp.record(tmp_path / "plan").check())


def test_the_command_says_it_with_its_exit_status(
    begun: RunRecord, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def status(*words: str) -> int:
        monkeypatch.setattr("sys.argv", ["frida-painter", *words])
        with pytest.raises(SystemExit) as left:
            commands.main()
        return int(left.value.code or 0)

    assert status("verify", str(begun.folder)) == 0 and capsys.readouterr().out.strip() == SAME
    (begun.folder / "goal" / "1" / "a.png").unlink()
    assert status("verify", str(begun.folder)) == 1 and "a.png is gone" in capsys.readouterr().out
