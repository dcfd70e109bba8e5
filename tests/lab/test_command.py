"""The commands of the experiments: what they open, what they write, and what they refuse."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from frida_painter_cli import commands
from frida_painter_lab.commands import ROWS, UNFINISHED, ExperimentRow
from frida_painter_lab.runs import Run
from frida_painter_lab.targets import Target
from marks import small_library

Said = tuple[int, str, str]
Say = Callable[..., Said]


@pytest.fixture
def say(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Say:
    """say(word, ...): the exit status, and what was said on both channels."""
    monkeypatch.chdir(tmp_path)

    def saying(*words: object) -> Said:
        monkeypatch.setattr("sys.argv", ["frida-painter", "experiments", *map(str, words)])
        with pytest.raises(SystemExit) as end:
            commands.main()
        told = capsys.readouterr()
        return int(end.value.code or 0), told.out, told.err

    return saying


def test_all_experiments_are_listed_with_what_they_are_for(say: Say) -> None:
    status, out, _ = say("list")
    assert status == 0
    lines = {line.split()[0]: line for line in out.splitlines()}
    assert lines.keys() == {row.name for row in ROWS} and len(lines) >= 10
    assert all(len(line.split()) > 5 for line in lines.values())


@pytest.mark.parametrize("row", ROWS, ids=[row.name for row in ROWS])
@pytest.mark.parametrize("quick", [False, True])
def test_a_row_opens_its_experiment_with_what_it_needs(row: ExperimentRow, quick: bool) -> None:
    given: dict[str, Any] = dict.fromkeys(row.takes) | {"brush": "fine", "quick": quick}
    chosen = {"seed": 7, "seeds": (4, 5), "first": 3, "strokes": 20}
    given |= {name: value for name, value in chosen.items() if name in row.takes}
    made: Any = row.open(given)
    assert (made.NAME, made.brush, made.quick) == (row.name, "fine", quick)
    for name in chosen.keys() & set(row.takes):
        assert getattr(made, name) == chosen[name]
    for option in row.shipped:
        pictures = getattr(made, option)
        assert isinstance(pictures, Target) or len(pictures) == (row.quick if quick and row.quick else len(pictures))
    if "library" in row.takes:
        made = type(made)(library=small_library(70), title="drawn", quick=quick).prepare(lambda progress: None)
    runs = made.all_runs
    assert runs and all(isinstance(run, Run) for run in runs) and len({run.key for run in runs}) == len(runs)


def test_an_experiment_leaves_its_table_and_pictures_and_is_the_same_in_processes(say: Say, tmp_path: Path) -> None:
    small_library(16).save(tmp_path / "mine.npz")
    tables = []
    for jobs in (1, 2):
        words = ("strokes-needed", "--library", "mine.npz", "--quick", "--jobs", jobs, "--out", f"by-{jobs}")
        status, out, err = say(*words)
        folder = tmp_path / f"by-{jobs}" / "strokes-needed"
        assert status == 0 and "mine" in out and str(Path(f"by-{jobs}/strokes-needed/table.md")) in out, err
        record = json.loads((folder / "table.json").read_text())
        assert record["settings"]["library"] == "mine" and not (folder / UNFINISHED).exists()
        assert {path.name for path in folder.iterdir()} == {"table.json", "table.md", *record["pictures"]}
        tables.append(record)
    assert tables[0] == tables[1]


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (("sim2real", "--seeds", "1,x"), "'x' is not a whole number"),
        (("sim2real", "--seeds", "1,1"), "twice"),
        (("replanning", "--seeds", "-1"), "-1 is not from 0"),
        (("ladder", "--strokes", "12"), "12 is not from 13"),
        (("continuous-strokes", "--brush", "mop"), "mop is no brush; give fine, medium, broad"),
        (("sim2real", "--target", "nowhere.jpg"), "nowhere.jpg does not exist"),
        (("stroke-model", "--library", "nowhere.npz"), "nowhere.npz does not exist"),
        (("alchemy",), "alchemy"),
    ],
)
def test_what_cannot_be_done_is_said_in_a_sentence(say: Say, tmp_path: Path, words: tuple[str, ...], says: str) -> None:
    status, _, err = say(*words)
    assert status == 2 and says in err and "Traceback" not in err
    assert list(tmp_path.iterdir()) == []
