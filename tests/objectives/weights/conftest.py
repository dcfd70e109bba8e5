from pathlib import Path

import pytest

from tiny_weights import tiny


@pytest.fixture
def catalogue(monkeypatch):
    """catalogue(weights, ...): these are all the weights there are; without a call, the tiny ones are."""

    def fill(*entries):
        for place in ("catalogue.all_weights", "all_weights"):
            monkeypatch.setattr(f"frida_painter.objectives.weights.{place}", lambda: entries)

    fill(tiny())
    return fill


@pytest.fixture
def index(tmp_path, monkeypatch) -> Path:
    """A folder that pip, as a person may configure it, takes for its only index."""
    folder = tmp_path / "index"
    folder.mkdir()
    monkeypatch.setenv("PIP_CONFIG_FILE", "/dev/null")
    monkeypatch.setenv("PIP_NO_INDEX", "1")
    monkeypatch.setenv("PIP_FIND_LINKS", str(folder))
    return folder
