"""The page is checked with the system's Node.js or that of PyPI; where neither can be had, the reason is told."""

import sys
from pathlib import Path
from types import ModuleType, SimpleNamespace

import pytest

from support.programs import load_program

ROOT = Path(__file__).parents[2]


@pytest.fixture
def check_page() -> ModuleType:
    return load_program(ROOT / "tools" / "check_page.py")


@pytest.mark.parametrize(
    ("version", "taken"), [("v20.11.0\n", True), ("v18.0.0\n", True), ("v16.20.2\n", False), ("", False)]
)
def test_only_a_node_that_has_a_test_runner_is_taken_from_the_system(
    check_page: ModuleType, monkeypatch: pytest.MonkeyPatch, version: str, taken: bool
) -> None:
    monkeypatch.setattr("shutil.which", lambda name: f"/usr/bin/{name}")
    monkeypatch.setattr("subprocess.run", lambda *_, **__: SimpleNamespace(stdout=version))
    assert (check_page.node_of_system() is not None) is taken


def test_where_node_cannot_be_had_nothing_fails_and_the_reason_is_told(
    check_page: ModuleType, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    asked: list[list[str]] = []

    def refuse(command: list[str], **_: object) -> SimpleNamespace:
        asked.append(command)
        return SimpleNamespace(returncode=1)

    monkeypatch.setattr("shutil.which", lambda name: None)
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    monkeypatch.setattr("subprocess.run", refuse)
    monkeypatch.setattr(sys, "argv", ["check_page.py", "test"])
    assert check_page.main() == 0
    assert "not checked (test): there is no Node.js 18 or newer, and pip cannot install" in capsys.readouterr().out
    assert asked[0][-1] == check_page.WHEEL and asked[0][-2].endswith("install.py")


@pytest.mark.parametrize(("status", "passed"), [(0, 0), (1, 1)])
def test_what_the_checks_find_is_the_exit_status(
    check_page: ModuleType, monkeypatch: pytest.MonkeyPatch, status: int, passed: int
) -> None:
    ran: list[list[str]] = []

    def run(command: list[str], **_: object) -> SimpleNamespace:
        ran.append(command)
        return SimpleNamespace(returncode=status)

    monkeypatch.setattr(check_page, "node_of_system", lambda: (["/usr/bin/node"], ["/usr/bin/npm"]))
    monkeypatch.setattr("subprocess.run", run)
    monkeypatch.setattr(sys, "argv", ["check_page.py", "test"])
    assert check_page.main() == passed
    assert ran[0][:2] == ["/usr/bin/node", "--test"] and "tests/web/static/drawing.test.js" in ran[0]
