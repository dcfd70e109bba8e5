from types import SimpleNamespace

import pytest

from frida_painter.brush.table import StrokeTable, TableDetail


@pytest.fixture
def coarse_brush(monkeypatch: pytest.MonkeyPatch) -> None:
    """Plans with a coarsely tabulated brush, which is there sooner."""
    coarse = SimpleNamespace(of=lambda model: StrokeTable.of(model, detail=TableDetail((2, 2, 2), 8)))
    monkeypatch.setattr("frida_painter.session.opening.StrokeTable", coarse)
