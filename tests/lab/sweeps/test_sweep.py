"""A sweep: every run once, however often it is begun, killed or gone wrong."""

import json
import shutil
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import torch
from PIL import Image

import frida_painter as fp
from frida_painter.errors import ConfigError, StorageError, SweepBusy, TryFailed, WorkerUnfit
from frida_painter.runs.painting_folder import content_hash
from frida_painter.strokes.plan import Plan
from frida_painter.system import storage
from frida_painter.system.storage import PART
from frida_painter_cli import commands
from frida_painter_lab import experiment as carrier
from frida_painter_lab import targets
from frida_painter_lab.engine import Share
from frida_painter_lab.experiment import Progress
from frida_painter_lab.runs import RunFolder
from frida_painter_lab.sweeps import runner
from frida_painter_lab.sweeps.report import read_state
from frida_painter_lab.sweeps.runner import perform
from frida_painter_lab.sweeps.sweep_spec import SweepFolder, SweepRun
from plugins import install
from sweep_engine import Here

SMALL = {"strokes": 4, "canvas": "120x90mm", "render_height": 64, "effort": 0.05, "brush": "fine", "colors": 2}


@pytest.fixture
def photo(tmp_path: Path) -> Path:
    path = tmp_path / "coffee.png"
    Image.open(Path(targets.__file__).with_name("coffee.jpg")).resize((120, 90)).save(path)
    return path


@pytest.fixture
def engine(monkeypatch: pytest.MonkeyPatch) -> Here:
    """The engine of all sweeps of a test, which does not plan: what a run gives is made up from its seed."""
    made = Here()
    monkeypatch.setattr(carrier, "Engine", lambda limits, slots: made)
    monkeypatch.setattr(runner, "_figures", lambda kind, opened, plan, folder: {"plan dB": 20.0 + opened.spec.seed})
    return made


def asked(photo: Path, seeds: int = 3, **more: Any) -> dict[str, Any]:
    return {"settings": {**SMALL, "image": str(photo)}, "grid": {"seed": list(range(seeds))}, **more}


def at_seed(number: int, act: Callable[[Share], object]) -> Callable[[Share], None]:
    """Does something before the run with that seed."""

    def between(share: Share) -> None:
        if share.runs[0].labels["seed"] == number:
            act(share)

    return between


def fail(error: BaseException) -> Callable[[object], None]:
    def failing(task: object) -> None:
        raise error

    return failing


def nothing(task: object) -> None:
    pass


def test_every_run_is_done_and_none_again(tmp_path: Path, photo: Path, engine: Here) -> None:
    heard: list[Progress] = []
    outcome = fp.sweep(asked(photo), tmp_path / "sweep", notify=heard.append)
    assert [record["figures"]["plan dB"] for record in outcome.records.values()] == [20.0, 21.0, 22.0]
    assert [one.doing.partition(",")[0] for one in heard] == [f"{done} of 3 runs done" for done in range(4)]
    assert [one.share for one in heard] == pytest.approx([0, 1 / 3, 2 / 3, 1]) and outcome.seconds_left == 0
    half = replace(outcome, records=dict([*outcome.records.items()][:1]))
    wall = next(iter(outcome.records.values()))["times"]["wall_seconds"]
    times = [replace(half, slots=slots).seconds_left for slots in (1, 2)]
    assert times == pytest.approx([2 * wall, wall])
    again = fp.sweep(asked(photo, 5), tmp_path / "sweep")
    assert len(engine.asked) == len({task.runs[0].key for task in engine.asked}) == 5
    assert again.done_before == 3 and len(again.records) == 5
    other = fp.sweep({"settings": {**SMALL, "seed": 1}, "grid": {"image": [str(photo)]}}, tmp_path / "sweep")
    assert len(engine.asked) == 5, "it was done for the first sweep"
    assert [record["labels"] for record in other.records.values()] == [{"image": "coffee.png"}]
    Image.new("RGB", (120, 90), "red").save(photo)
    assert fp.sweep(asked(photo, 1), tmp_path / "sweep").done_before == 0, "another photograph"


def test_what_fails_is_reported_tried_again_next_time_and_stops_nothing(tmp_path: Path, photo: Path, engine: Here):
    engine.between = at_seed(1, fail(TryFailed("It exploded.")))
    outcome = fp.sweep(asked(photo), tmp_path / "sweep")
    (failure,) = outcome.failures.values()
    times = [record["times"][name] for record in outcome.records.values() for name in ("cpu_seconds", "wall_seconds")]
    assert all(0 <= took < 600 for took in times)
    assert len(outcome.records) == 2 and failure["error"] == "It exploded." and failure["labels"] == {"seed": 1}
    told = read_state(tmp_path / "sweep").lines()
    assert told == ["sweep: 2 of 3 runs done, 1 failed.", "  seed 1: It exploded."]
    engine.between = nothing
    assert fp.sweep(asked(photo), tmp_path / "sweep").failures == {}
    assert read_state(tmp_path / "sweep").lines() == ["sweep: 3 of 3 runs done."]


def test_an_interrupted_sweep_goes_on(tmp_path: Path, photo: Path, engine: Here) -> None:
    engine.between = at_seed(2, fail(KeyboardInterrupt()))
    with pytest.raises(KeyboardInterrupt):
        fp.sweep(asked(photo), tmp_path / "sweep")
    assert "nobody works on it; run the sweep again to continue" in read_state(tmp_path / "sweep").lines()[0]
    engine.between = nothing
    assert fp.sweep(asked(photo), tmp_path / "sweep").done_before == 2


def test_results_of_another_machine_are_taken_over(tmp_path: Path, photo: Path, engine: Here) -> None:
    """As docs/how-to/sweep.md says: parts of a grid, whose runs are copied into one folder."""
    fp.sweep(asked(photo, 2), tmp_path / "here")
    fp.sweep({**asked(photo), "grid": {"seed": [2, 3]}}, tmp_path / "there")
    shutil.copytree(tmp_path / "there" / "runs", tmp_path / "here" / "runs", dirs_exist_ok=True)
    assert fp.sweep(asked(photo, 4), tmp_path / "here").done_before == 4 and len(engine.asked) == 4


def test_damaged_results_are_made_again_and_a_spoiled_folder_stops_no_other(
    tmp_path: Path, photo: Path, engine: Here
) -> None:
    made = fp.sweep(asked(photo), tmp_path / "s")
    first, second, third = (RunFolder(made.folder, run.key).path for run in made.runs)
    (first / "result.json").write_text((first / "result.json").read_text()[:-20])
    assert fp.sweep(asked(photo), tmp_path / "s").done_before == 2
    shutil.rmtree(first)
    first.write_text("hi")
    (third / "result.json").write_text((second / "result.json").read_text())
    again = fp.sweep(asked(photo), tmp_path / "s")
    assert set(again.failures) == {first.name} and set(again.records) == {second.name, third.name}
    assert json.loads((third / "result.json").read_text())["key"] == third.name


def test_a_photograph_that_changes_or_vanishes_meanwhile_is_not_painted(tmp_path: Path, photo: Path, engine: Here):
    engine.between = at_seed(1, lambda share: Image.new("RGB", (120, 90), "red").save(photo))
    made = fp.sweep(asked(photo), tmp_path / "s")
    assert len(made.records) == 1 and len(made.failures) == 2
    assert all("coffee.png has changed since the sweep began" in why["error"] for why in made.failures.values())
    photo.unlink()
    assert len(read_state(tmp_path / "s").records) == 1
    with pytest.raises(ConfigError, match=r"coffee\.png does not exist"):
        fp.sweep(asked(photo), tmp_path / "s")


def test_files_are_found_from_anywhere_and_those_of_one_name_are_told_apart(
    tmp_path: Path, photo: Path, engine: Here, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "n").mkdir()
    (tmp_path / "n" / f"{PART}ab12cd34.json").touch()  # left by a killed first write
    assert len(fp.sweep(asked(Path(photo.name)), "n").records) == 3
    monkeypatch.chdir("/")
    assert len(read_state(tmp_path / "n").runs) == 3
    names = []
    for folder in ("a", "b"):
        (tmp_path / folder).mkdir()
        Image.open(photo).rotate(90 * len(names)).save(tmp_path / folder / "me.png")
        names.append(str(tmp_path / folder / "me.png"))
    made = fp.sweep({"settings": SMALL, "grid": {"image": names, "seed": [0]}}, tmp_path / "s")
    assert [run.labels["image"] for run in made.runs] == names
    words = fp.sweep({"settings": SMALL, "grid": {"text": ["a red/green apple", "a pear"]}}, tmp_path / "w")
    assert [run.labels["text"] for run in words.runs] == ["a red/green apple", "a pear"]


@pytest.mark.parametrize("title", ["../../away", "/tmp/away", "a\x00b", "..."])
def test_a_title_does_not_lead_out_of_the_folder_of_sweeps(title: str) -> None:
    folder = runner.default_folder(runner.SweepSpec(title=title))
    assert folder.parent == Path("sweeps") and folder.name and "\x00" not in folder.name and folder.name != ".."


def test_two_drivers_do_not_share_a_folder_and_others_are_left_alone(tmp_path: Path, photo: Path, engine: Here):
    def second(share: Share) -> None:
        with pytest.raises(SweepBusy):
            fp.sweep(asked(photo), tmp_path / "sweep")
        assert read_state(tmp_path / "sweep").working

    engine.between = second
    assert len(fp.sweep(asked(photo), tmp_path / "sweep").records) == 3 and not read_state(tmp_path / "sweep").working
    with pytest.raises(StorageError, match="holds something that is no sweep"):
        fp.sweep(asked(photo), tmp_path)
    storage.write_json(tmp_path / "other" / "sweep.json", {"format": "something else"})
    for folder in (tmp_path, tmp_path / "other"):
        with pytest.raises(ConfigError, match="no sweep"):
            read_state(folder)


def test_a_full_disk_ends_the_sweep_and_loses_nothing(
    tmp_path: Path, photo: Path, engine: Here, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(share: Share) -> None:
        monkeypatch.setattr(storage.shutil, "disk_usage", lambda path: type("Usage", (), {"free": 1000}))
        raise StorageError("No space left on device.")

    engine.between = at_seed(1, full)
    with pytest.raises(StorageError, match="0 MB free"):
        fp.sweep(asked(photo), tmp_path / "sweep")
    monkeypatch.undo()
    state = read_state(tmp_path / "sweep")
    assert len(state.records) == 1 and state.failures == {}


def test_another_version_ends_the_sweep(tmp_path: Path, photo: Path, engine: Here):
    def with_another_version(share: Share) -> None:
        perform(Share((replace(share.runs[0], program="0.0.1"),), share.keep))

    engine.between = with_another_version
    with pytest.raises(WorkerUnfit, match=r"and the sweep was begun with 0\.0\.1"):
        fp.sweep(asked(photo), tmp_path / "sweep")


def test_wrong_sweeps_are_refused_before_anything_begins(
    tmp_path: Path, photo: Path, engine: Here, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(ConfigError, match=r"--strokes was given 0.*--strokes was given -1"):
        fp.sweep({"settings": {"image": str(photo)}, "grid": {"strokes": [0, 20, -1]}}, tmp_path / "sweep")
    for goal in (5, "coffee.png", ["coffee.png"]):
        with pytest.raises(ConfigError, match=r"goal was given .*; it is a list of tables"):
            fp.sweep({"settings": {**SMALL, "goal": goal}}, tmp_path / "s")
    grid = {"seed": list(range(10_000)), "strokes": list(range(1, 1001))}
    with pytest.raises(ConfigError, match=r"10,000,000 runs, and 10,000 are the most"):
        fp.sweep({"settings": {"image": str(photo)}, "grid": grid}, tmp_path / "sweep")
    lines = "\n".join(f"{name} = {values}" for name, values in grid.items())
    (tmp_path / "many.toml").write_text(f"settings = {{image = '{photo}'}}\n[grid]\n{lines}")
    monkeypatch.setattr("sys.argv", ["frida-painter", "sweep", str(tmp_path / "many.toml")])
    with pytest.raises(SystemExit) as end:
        commands.main()
    assert end.value.code == 2 and "10,000,000 runs, and nothing was begun; say --yes" in capsys.readouterr().err
    assert engine.asked == [] and not (tmp_path / "sweep").exists() and not Path("sweeps").exists()


def test_a_run_plans_paints_and_evaluates(tmp_path: Path, photo: Path, in_small_world: None) -> None:
    """In this process: what a run writes is what PaintingRun gives."""
    (tmp_path / "sweep").mkdir()

    def done(kind: str, **more: Any) -> tuple[dict[str, Any], Path]:
        run = SweepRun.of(kind, {}, {**SMALL, "image": str(photo), "replans": 1, **more}, hash_of=content_hash)
        record = perform(Share((run,), str(tmp_path / "sweep")))
        assert perform(Share((run,), str(tmp_path / "sweep"))) == json.loads(json.dumps(record))
        return record, RunFolder(tmp_path / "sweep", run.key).path

    planned, folder = done("plan", ground="#c8a878")
    assert {"plan dB", "expected dB", "loss of the plan"} <= set(planned["figures"])
    plan = Plan.load(folder / "plan.json")
    with fp.PaintingRun(fp.RunSpec.of(**SMALL, ground="#c8a878", goal=[{"image": str(photo)}])) as run:
        assert torch.equal(run.plan().strokes.position, plan.strokes.position)
    painted, its_folder = done("painting")
    assert painted["figures"]["strokes painted"] == 4 and 3 < painted["figures"]["painting dB"] < 60
    assert (its_folder / "painting.png").exists()
    shutil.copytree(folder, tmp_path / "kept")
    evaluated, _ = done("evaluation", plan=str(tmp_path / "kept" / "plan.json"), strokes=300, canvas="20x20cm")
    assert evaluated["figures"]["plan dB"] == pytest.approx(planned["figures"]["plan dB"], abs=1e-3)
    assert evaluated["settings"]["strokes"] == 4 and evaluated["settings"]["replans"] == 0
    assert evaluated["settings"]["ground"] == "#c8a878", "a plan is judged on its own ground"
    assert evaluated["times"]["cpu_seconds"] > 0 and evaluated["versions"]["frida-painter"]


def test_the_command_line_does_a_sweep_in_processes(tmp_path: Path, photo: Path) -> None:
    settings = "\n".join(f"{name} = {json.dumps(value)}" for name, value in SMALL.items())
    (tmp_path / "tiny.toml").write_text(f"[settings]\n{settings}\n[grid]\nimage = ['coffee.png']\nseed = [0, 1]\n")
    said = subprocess.run(
        [sys.executable, "-m", "frida_painter", "sweep", str(tmp_path / "tiny.toml"), "--out", str(tmp_path / "out")],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert said.returncode == 0, said.stderr
    assert said.stdout.startswith("2 runs of 2 done; 2 in ")
    assert SweepFolder(tmp_path / "out").read_request()[0].title == "tiny"
    assert len(read_state(tmp_path / "out").records) == 2


def test_a_changed_plug_in_makes_other_runs_and_the_old_ones_are_still_reported(
    tmp_path: Path, photo: Path, engine: Here, monkeypatch: pytest.MonkeyPatch
) -> None:
    points = {"frida_painter.replan_policies": {"calm": "calm_policy:parse"}}
    install(tmp_path / "site", monkeypatch, "calm", points, {"calm_policy": "a = 1\n"})
    wanted = {"settings": {"image": str(photo), **SMALL}, "grid": {"seed": [0, 1]}}
    first = fp.sweep(wanted, tmp_path / "out")
    assert len(first.records) == 2 and fp.sweep(wanted, tmp_path / "out").done_before == 2
    (tmp_path / "site" / "calm_policy.py").write_text("a = 22\n")
    assert len(read_state(tmp_path / "out").records) == 2  # what was made is still told
    again = fp.sweep(wanted, tmp_path / "out")
    assert again.done_before == 0 and {run.key for run in again.runs}.isdisjoint(run.key for run in first.runs)
    rows = again.table()
    assert [row["plan dB"] for row in rows] == [20.0, 21.0] and "version plug-in calm" in rows[0]


def test_runs_are_compared_in_pairs_and_a_wrong_name_is_answered(tmp_path: Path, photo: Path, engine: Here) -> None:
    wanted = {"settings": {"image": str(photo), **SMALL}, "grid": {"seed": [0, 1, 2, 3], "effort": [0.05, 0.06]}}
    outcome = fp.sweep(wanted, tmp_path / "out")
    (effect,) = outcome.compare("effort", "plan dB")
    assert (effect.first, effect.second, effect.difference.count) == (0.05, 0.06, 4)
    assert effect.difference.value == 0  # the stub's figure is that of the seed alone
    for words, told in ((("effrt", "plan dB"), r"there are effort, seed"), (("effort", "dB"), r"there are plan dB")):
        with pytest.raises(ConfigError, match=told):
            outcome.compare(*words)
