"""The runner of the test suite runs all tests, each once, and tells of those that failed."""

from pathlib import Path

import pytest

import measured
from support.programs import load_program

ROOT = Path(__file__).parents[2]


@pytest.fixture
def runner():
    return load_program(ROOT / "tools" / "run_tests.py")


@pytest.mark.parametrize("quick", [False, True])
def test_every_file_of_tests_is_in_one_group(runner, quick: bool) -> None:
    groups = runner.list_groups(quick=quick)
    found = sorted(ROOT / path for group in groups for path in group)
    slow = measured.read_seconds()
    assert found == sorted(
        file
        for file in (ROOT / "tests").rglob("test_*.py")
        if not quick or any(f"{file.relative_to(ROOT)}::{name}" not in slow for name in measured.list_tests(file))
    )


def test_the_longest_group_comes_first_and_a_long_file_is_one(runner, tmp_path: Path, monkeypatch) -> None:
    monkeypatch.setattr(runner, "ROOT", tmp_path)
    for number in range(4):
        file = tmp_path / f"tests/room/test_{number}.py"
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text("def test_it(): ...\n")
    took = {
        f"tests/room/test_{number}.py::test_it": (float(seconds), "") for number, seconds in enumerate((9, 9, 80, 7))
    }
    monkeypatch.setattr(runner, "read_seconds", lambda: took)
    groups = [[path[-4] for path in group] for group in runner.list_groups()]
    assert groups == [["2"], ["0", "1"], ["3"]] and runner.list_groups(quick=True) == []


@pytest.mark.parametrize("quick", [False, True])
def test_what_was_measured_is_kept_once_for_all_cases(tmp_path: Path, quick: bool) -> None:
    """Quick tests say which of them are slow; only the whole run says how slow, and which are slow no more."""
    (tmp_path / "test_it.py").write_text("".join(f"def test_{letter}(): ...\n" for letter in "abcd"))
    known = tmp_path / "seconds.txt"
    known.write_text("1.0 test_it.py::test_c  # why\n1.0 test_it.py::test_d\n1.0 test_it.py::test_gone\n")
    times = [
        "0.010 9.000 test_it.py::test_a[x, 1-y]",
        "0.900 0.100 test_it.py::test_a[z]",
        "0.100 0.100 test_it.py::test_b",
        "30.00 30.00 test_it.py::test_c",
        "0.010 0.010 test_it.py::test_d",
    ]
    measured.renew_seconds(times, tmp_path, known, quick=quick)
    reason, slow = (
        {"test_it.py::test_c": (30.0, "why")},
        {"test_it.py::test_a": (0.9, ""), "test_it.py::test_d": (0.0, "")},
    )
    assert measured.read_seconds(known) == reason | (slow if quick else {})


def test_every_slow_test_is_there() -> None:
    named = measured.read_seconds()
    files = {name.partition("::")[0] for name in named}
    there = {f"{file}::{name}" for file in files for name in measured.list_tests(ROOT / file)}
    assert set(named) <= there


def accept_times(tests: Path) -> None:
    """Lets pytest take the option with which the runner asks for seconds."""
    (tests / "conftest.py").write_text('def pytest_addoption(parser): parser.addoption("--times")')


def test_a_group_that_fails_stops_none_and_fails_the_run(runner, tmp_path: Path, monkeypatch, capfd) -> None:
    rooms = {"one": "def test_it(): assert 1 == 2", "two": "def test_it(): pass", "three": "no_test = 1"}
    for room, text in rooms.items():
        (tmp_path / "tests" / room).mkdir(parents=True)
        (tmp_path / "tests" / room / f"test_{room}.py").write_text(text)
    accept_times(tmp_path / "tests")
    monkeypatch.setattr(runner, "ROOT", tmp_path)
    monkeypatch.setattr(runner, "TIMES", tmp_path / "times/it")
    monkeypatch.setattr(runner, "GROUP", 0.0)
    monkeypatch.setattr(runner, "LARGE", ())
    alone = ["-q", "-c", "/dev/null", "--rootdir", str(tmp_path), "-p", "no:schemathesis"]
    assert runner.main(["--jobs", "2", *alone]) == 1
    said = capfd.readouterr().out
    assert "assert 1 == 2" in said and "Failed: tests/one/test_one.py\n" in said and "1 passed" in said
    assert said.count("assert 1 == 2") >= 2 and "Once more, alone:" in said
    assert "2 of 3 groups of tests passed in " in said
    assert runner.main([*alone, "-k", "nothing"]) == 0, "no test is no failure"


def test_a_test_that_passes_alone_fails_nothing(runner, tmp_path: Path, monkeypatch, capfd) -> None:
    (tmp_path / "tests/one").mkdir(parents=True)
    test = """
import os
def test_it():
    seen = os.path.exists("was")
    open("was", "w").close()
    assert seen
"""
    (tmp_path / "tests/one/test_one.py").write_text(test)
    accept_times(tmp_path / "tests")
    monkeypatch.setattr(runner, "ROOT", tmp_path)
    monkeypatch.setattr(runner, "TIMES", tmp_path / "times/it")
    alone = ["-q", "-c", "/dev/null", "--rootdir", str(tmp_path), "-p", "no:schemathesis"]
    assert runner.main(["--jobs", "1", *alone]) == 0
    said = capfd.readouterr().out
    assert "Once more, alone:" in said and "assert seen" in said


def test_a_plain_processor_is_asked_for_before_any_library_is_loaded(runner, tmp_path: Path, monkeypatch) -> None:
    monkeypatch.setattr(runner.os, "environ", {})
    monkeypatch.setattr(runner, "TIMES", tmp_path / "times")
    asked = []
    monkeypatch.setattr(runner, "run_groups", lambda *given: asked.append((given[1], dict(runner.os.environ))) or [])
    assert runner.main(["--plain-processor", "-x"]) == 0
    assert asked == [(["--times", str(tmp_path / "times"), "--threads", "2", "-x"], runner.PLAIN_PROCESSOR)]
