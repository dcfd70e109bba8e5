import pytest

from marks import coarse_table


@pytest.fixture
def coarse_brush(monkeypatch: pytest.MonkeyPatch) -> None:
    """Plans with a coarsely tabulated brush, which is there sooner."""
    monkeypatch.setattr("frida_painter.runs.settle.cached_table", coarse_table)
