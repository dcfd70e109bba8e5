"""What other packages register is told where a person chooses, without being imported."""

import sys
from pathlib import Path

import pytest

from frida_painter import registry
from frida_painter_cli.options import planning_options
from plugins import install


def test_the_help_names_parts_of_other_packages(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def said() -> dict[str, str]:
        return {one.name: one.annotation.__metadata__[0].help for one in planning_options() if one.name in wanted}

    wanted = {"brushes": registry.STROKE_MODELS, "strokes_of": registry.STROKE_FAMILIES,
              "planner": registry.PLANNERS}  # fmt: skip
    assert not any("Installed packages" in text for text in said().values())
    points = {group: {f"my-{name}": "calm_parts:KIND"} for name, group in wanted.items()}
    install(tmp_path, monkeypatch, "calm", points, {"calm_parts": "1/0\n"})
    assert all(f"Installed packages add my-{name}." in text for name, text in said().items())
    assert "calm_parts" not in sys.modules
