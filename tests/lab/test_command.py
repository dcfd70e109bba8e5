import json
from collections.abc import Callable
from importlib import import_module
from inspect import signature
from pathlib import Path
from typing import Any

import pytest

from frida_painter.cli import commands
from frida_painter.lab import conduct, paintings, targets
from frida_painter.lab.commands import ROWS, ExperimentRow
from frida_painter.lab.targets import Target
from marks import small_library

Said = tuple[int, str, str]
Run = Callable[..., Said]


@pytest.fixture
def run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], in_small_world: None
) -> Run:
    """run(word, ...): the exit status, and what was said on both channels."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(conduct, "slots_here", lambda limits, most=None: most or 1)

    def running(*words: object) -> Said:
        monkeypatch.setattr("sys.argv", ["frida-painter", "experiments", *map(str, words)])
        with pytest.raises(SystemExit) as end:
            commands.main()
        told = capsys.readouterr()
        return int(end.value.code or 0), told.out, told.err

    return running


def test_all_experiments_are_listed_with_what_they_are_for(run: Run) -> None:
    status, out, _ = run("list")
    assert status == 0
    lines = {line.split()[0]: line for line in out.splitlines()}
    assert lines.keys() == {row.name for row in ROWS} and len(lines) >= 14
    assert all(len(line.split()) > 5 for line in lines.values())


@pytest.mark.parametrize("row", ROWS, ids=[row.name for row in ROWS])
@pytest.mark.parametrize("quick", [False, True])
def test_a_row_calls_its_function_with_what_it_needs(
    row: ExperimentRow, quick: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Every argument without a default is given, and none that the function does not know."""
    module = import_module(f"frida_painter.lab.{row.module or row.name.replace('-', '_')}")
    name = "experiment" if "jobs" in row.takes else "run"
    asked = signature(getattr(module, name))
    bound: list[dict[str, Any]] = []

    def called(*arguments: Any, **named: Any) -> str:
        bound.append(asked.bind(*arguments, **named).arguments)
        return "outcome"

    called.__signature__ = asked  # type: ignore[attr-defined]
    monkeypatch.setattr(module, name, called)
    monkeypatch.setattr(conduct, "run_in_processes", lambda make, keep, notify, jobs: (make(), jobs)[0])
    monkeypatch.setattr(paintings, "library_of", lambda path, *rest: ("library", "its name", rest[-1]))
    options = signature(row.command()).parameters
    given = {each.name: each.default for each in options.values()} | {"brush": "fine", "quick": quick}
    assert row.run({**given, "seed": 7, "seeds": (4, 5)}, tmp_path, lambda progress: None) == "outcome"
    (found,) = bound
    assert found.get("seed", 7) == 7 and found.get("seeds", (4, 5)) == (4, 5)
    assert "fine" in (found.get("brush"), getattr(found["scale"], "brushes", None)) or "library" in found
    scales = module if hasattr(module, "QUICK") else paintings
    assert found["scale"].strokes == (scales.QUICK if quick else scales.FULL).strokes
    pictures = [part for part in found.values() if isinstance(part, tuple) and part and isinstance(part[0], Target)]
    assert len(pictures) == sum(option in ("photos", "drawings", "styles") for option in row.takes)


@pytest.mark.slow
def test_an_experiment_leaves_its_table_and_pictures(run: Run, tmp_path: Path) -> None:
    status, out, _ = run("continuous-strokes", "--brush", "fine", "--seed", 3, "--quick", "--out", "found")
    folder = tmp_path / "found" / "continuous-strokes"
    assert status == 0 and str(Path("found/continuous-strokes/table.md")) in out
    record = json.loads((folder / "table.json").read_text())
    assert record["settings"]["brush"] == "fine" and record["settings"]["seed"] == 3
    assert {path.name for path in folder.iterdir()} == {"table.json", "table.md", *record["pictures"]}


@pytest.mark.slow
@pytest.mark.parametrize("name", ["sim2real", "replanning"])
def test_paintings_of_ones_own_picture_and_nothing_unfinished_is_left(
    run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    module = import_module(f"frida_painter.lab.{name}")
    monkeypatch.setattr(module, "QUICK", module.QUICK.with_values(canvas="120x90mm"))
    photo = Path(targets.__file__).with_name("cat.jpg")
    status, _, _ = run(name, "--target", photo, "--seeds", "5", "--quick", "--brush", "fine", "--out", "found")
    assert status == 0
    record = json.loads((tmp_path / "found" / name / "table.json").read_text())
    assert record["settings"]["seeds"] == [5]
    assert not (tmp_path / "found" / name / conduct.UNFINISHED).exists()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "words"),
    [("continuous-strokes", ()), ("stroke-model", ()), ("strokes-needed", ()), ("real-strokes", ("--seeds", "7"))],
)
def test_a_library_of_ones_own(run: Run, tmp_path: Path, name: str, words: tuple[str, ...]) -> None:
    small_library(16).save(tmp_path / "mine.npz")
    status, out, _ = run(name, "--library", "mine.npz", "--quick", "--out", "found", *words)
    assert status == 0 and "mine" in out
    record = json.loads((tmp_path / "found" / name / "table.json").read_text())
    assert record["settings"]["library"] == "mine"
    assert not (tmp_path / "found" / name / conduct.UNFINISHED).exists()


@pytest.mark.slow
def test_without_a_library_one_is_painted(run: Run, tmp_path: Path) -> None:
    status, out, _ = run("stroke-model", "--brush", "fine", "--quick", "--out", "found")
    assert status == 0 and "virtual fine brush" in out


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (("sim2real", "--seeds", "1,x"), "'x' is not a whole number"),
        (("sim2real", "--seeds", "1,1"), "twice"),
        (("replanning", "--seeds", "-1"), "-1 is not from 0"),
        (("ladder", "--strokes", "12"), "12 is not from 13"),
        (("continuous-strokes", "--brush", "mop"), "mop is no brush; give fine, medium, broad"),
        (("sim2real", "--target", "nowhere.jpg"), "nowhere.jpg does not exist"),
        (("ladder", "--brush", "foo"), "foo is no brush; give fine, medium, broad"),
        (("stroke-model", "--library", "nowhere.npz"), "nowhere.npz does not exist"),
        (("alchemy",), "alchemy"),
    ],
)
def test_what_cannot_be_done_is_said_in_a_sentence(run: Run, tmp_path: Path, words: tuple[str, ...], says: str) -> None:
    status, _, err = run(*words)
    assert status == 2 and says in err and "Traceback" not in err
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow
def test_trials_are_measured_in_processes_with_the_same_figures(run: Run, tmp_path: Path) -> None:
    small_library(16).save(tmp_path / "mine.npz")
    tables = []
    for jobs in (1, 2):
        status, _, err = run(
            "strokes-needed", "--library", "mine.npz", "--quick", "--jobs", jobs, "--out", f"by-{jobs}"
        )
        assert status == 0, err
        tables.append(json.loads((tmp_path / f"by-{jobs}" / "strokes-needed" / "table.json").read_text()))
    assert tables[0] == tables[1]
