from collections.abc import Sequence
from pathlib import Path

import pytest

from support.commandline import Command, Said, run_command


@pytest.fixture(scope="module", autouse=True)
def _cheap_paintings(request: pytest.FixtureRequest) -> None:
    """Paintings of this room cost as little as those of `small_world`, but for modules with TRUE_PHOTOGRAPHS."""
    if not getattr(request.module, "TRUE_PHOTOGRAPHS", False):
        request.getfixturevalue("small_world")


@pytest.fixture
def call(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Command:
    """call(word, ..., typing=[line, ...]): what it says in the test's folder; a person types exactly these lines."""
    monkeypatch.chdir(tmp_path)

    def run(*words: object, typing: Sequence[str] | None = None) -> Said:
        lines = list(typing or ())

        def answer(*_: object, **__: object) -> str:
            if not lines:
                raise EOFError
            return lines.pop(0)

        if typing is not None:
            monkeypatch.setattr("builtins.input", answer)
            monkeypatch.setattr("rich.console.Console.input", answer)
        status = run_command(*words)
        told = capsys.readouterr()
        assert not lines, f"{lines} was not asked for: {told.out}{told.err}"
        return Said(status, told.out, told.err)

    return run
