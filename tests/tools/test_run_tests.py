"""The runner of the test suite runs all tests, each once, and tells of those that failed."""

from pathlib import Path

import pytest

from support.programs import load_program

ROOT = Path(__file__).parents[2]


@pytest.fixture
def runner():
    return load_program(ROOT / "tools" / "run_tests.py")


@pytest.mark.parametrize("count", [None, 2, 3])
def test_every_file_of_tests_is_in_one_group(runner, count: int | None) -> None:
    groups = runner.list_groups()
    if count is not None:
        groups = runner.deal_files(groups, count)
        assert len(groups) == count
    paths = [ROOT / path for group in groups for path in group]
    found = [file for path in paths for file in (path.rglob("test_*.py") if path.is_dir() else [path])]
    assert sorted(found) == sorted((ROOT / "tests").rglob("test_*.py"))


def test_what_took_long_is_named_once_for_all_its_cases_and_what_is_gone_no_more(
    runner, tmp_path: Path, monkeypatch
) -> None:
    (tmp_path / "test_it.py").write_text("def test_a(): ...\ndef test_b(): ...\ndef test_c(): ...")
    monkeypatch.setattr(runner, "ROOT", tmp_path)
    monkeypatch.setattr(runner, "SLOW_TESTS", tmp_path / "slow.txt")
    runner.SLOW_TESTS.write_text("test_it.py::test_c\ntest_it.py::test_gone\ntest_gone.py::test_a\n")
    runner.renew_slow_tests(
        "0.010 9.000 test_it.py::test_a[x, 1-y]\n0.900 0.100 test_it.py::test_a[z]\n0.1 0.1 test_it.py::test_b\n"
    )
    assert runner.SLOW_TESTS.read_text() == "test_it.py::test_a\ntest_it.py::test_c\n"


def test_every_slow_test_is_there(runner) -> None:
    named = runner.SLOW_TESTS.read_text().splitlines()
    assert named == sorted(set(named))
    assert [name for name in named if not runner.is_test(name)] == []


@pytest.mark.slow
def test_a_group_that_fails_stops_none_and_fails_the_run(runner, tmp_path: Path, monkeypatch, capfd) -> None:
    rooms = {"one": "def test_it(): assert 1 == 2", "two": "def test_it(): pass", "three": "no_test = 1"}
    for room, text in rooms.items():
        (tmp_path / "tests" / room).mkdir(parents=True)
        (tmp_path / "tests" / room / f"test_{room}.py").write_text(text)
    monkeypatch.setattr(runner, "ROOT", tmp_path)
    monkeypatch.setattr(runner, "GROUPS", (("one",), ("two",)))
    monkeypatch.setattr(runner, "LARGE", ())
    alone = ["-q", "-c", "/dev/null", "--rootdir", str(tmp_path), "-p", "no:schemathesis"]
    assert runner.main(["--jobs", "2", *alone]) == 1
    said = capfd.readouterr().out
    assert "assert 1 == 2" in said and "Failed: tests/one\n" in said and "1 passed" in said
    assert said.count("assert 1 == 2") >= 2 and "Once more, alone:" in said
    assert "2 of 3 groups of tests passed in " in said
    assert runner.main([*alone, "-k", "nothing"]) == 0, "no test is no failure"


@pytest.mark.slow
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
    monkeypatch.setattr(runner, "ROOT", tmp_path)
    monkeypatch.setattr(runner, "GROUPS", (("one",),))
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
    assert asked == [(["--threads", "2", "-x"], runner.PLAIN_PROCESSOR)]
