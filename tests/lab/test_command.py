"""The commands of the experiments: what they open, what they write, and what they refuse."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from frida_painter_cli import commands
from frida_painter_lab import commands as experiments
from frida_painter_lab.commands import EXPERIMENTS, UNFINISHED
from frida_painter_lab.runs import Run
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
    assert lines.keys() == set(EXPERIMENTS) and len(lines) >= 4
    assert all(len(line.split()) > 5 for line in lines.values())


@pytest.mark.parametrize("name", EXPERIMENTS)
@pytest.mark.parametrize("quick", [(), ("--quick",)])
def test_a_command_opens_its_experiment_with_what_it_needs(
    say: Say, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str, quick: tuple[str, ...]
) -> None:
    opened: list[Any] = []
    monkeypatch.setattr(experiments, "conduct", lambda *given: opened.append(given))
    more = ("--strokes", "20") if name == "sim2real" else ()
    status, _, err = say(name, "--brush", "fine", "--seeds", "4,5", "--jobs", "3", *quick, *more)
    assert status == 0, err
    ((made, folder, jobs),) = opened
    assert (made.NAME, made.brush, made.quick, made.seeds) == (name, "fine", bool(quick), (4, 5))
    assert (folder, jobs) == (Path("experiments") / name, 3)
    assert name != "sim2real" or (made.strokes == 20 and len(made.photos) == 5)
    assert name != "replanning" or [one.name for one in made.photos] == ["coffee"]
    assert name != "semantic" or len(made.photos) == 8
    if name == "strokes-needed":
        made = type(made)(library=small_library(70), title="drawn", quick=bool(quick)).prepare(lambda progress: None)
    runs = made.all_runs
    assert runs and all(isinstance(run, Run) for run in runs) and len({run.key for run in runs}) == len(runs)


def test_an_experiment_leaves_its_table_and_pictures_and_is_the_same_in_processes(say: Say, tmp_path: Path) -> None:
    small_library(16).save(tmp_path / "mine.npz")
    tables = []
    for jobs in (1, 2):
        given = ("--library", "mine.npz", "--seeds", "0", "--quick", "--jobs", jobs, "--out", f"by-{jobs}")
        status, out, err = say("strokes-needed", *given)
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
        (("sim2real", "--strokes", "12"), "12 is not from 13"),
        (("sim2real", "--brush", "mop"), "mop is no brush; give fine, medium, broad"),
        (("sim2real", "--target", "nowhere.jpg"), "nowhere.jpg does not exist"),
        (("strokes-needed", "--library", "nowhere.npz"), "nowhere.npz does not exist"),
        (("alchemy",), "alchemy"),
    ],
)
def test_what_cannot_be_done_is_said_in_a_sentence(say: Say, tmp_path: Path, words: tuple[str, ...], says: str) -> None:
    status, _, err = say(*words)
    assert status == 2 and says in err and "Traceback" not in err
    assert list(tmp_path.iterdir()) == []
