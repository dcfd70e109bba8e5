from pathlib import Path

import pytest

from frida_painter import images
from frida_painter.easel.open import open_easel
from frida_painter.easel.order import EaselOrder
from frida_painter.errors import ConfigError
from frida_painter.runs import settle
from frida_painter.runs.run import PaintingRun
from frida_painter.runs.settle import IN_LAYERS, IN_ONE_LAYER, brushes_of, choices
from frida_painter.runs.spec import RunSpec
from support.planning import picture

TRUE_PHOTOGRAPHS = True

SMALL = {"colors": 2, "render_height": 64, "effort": 0.1, "film": False, "replans": 1}


@pytest.fixture(scope="module")
def photo(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("photo") / "disc_and_bar.png"
    images.save(picture(90, 120), path)
    return path


def spec(photo: Path, **given: object) -> RunSpec:
    return RunSpec.of(goal=[{"image": str(photo)}], **{**SMALL, "brushes": "auto", **given})


def test_the_brush_of_the_least_expected_loss_is_taken_and_painted_with(photo: Path) -> None:
    with PaintingRun(spec(photo, strokes=6)) as run:
        painting = run.simulate()
        assert run.spec.brushes in IN_ONE_LAYER and tuple(run.planner.models) == (run.spec.brushes,)
        losses = {}
        for brush in IN_ONE_LAYER:
            with PaintingRun(spec(photo, strokes=6, brushes=brush, effort=0.05)) as other:
                losses[brush] = other.planner.expected_loss(other.plan(), other.planner.bare)
        assert run.spec.brushes == min(losses, key=lambda brush: losses[brush])
        assert any(f"best: {run.spec.brushes}." in remark for remark in run.remarks)
    assert painting.painted == 6


def test_with_many_strokes_layers_are_chosen_among_and_a_plan_tells_its_brushes(photo: Path) -> None:
    with PaintingRun(spec(photo, strokes=100, effort=0.05)) as run:
        plan = run.plan()
        assert run.spec.brushes in IN_LAYERS
    again = spec(photo, strokes=100, brushes=brushes_of(plan))
    with PaintingRun(again) as other:
        assert other.planner.layer_sizes(100) == plan.layer_sizes and other.planner.layer_kinds(100) == plan.brushes


def test_where_time_is_short_there_is_one_layer(photo: Path) -> None:
    assert choices(spec(photo, strokes=200, minutes=30.0)) == IN_ONE_LAYER
    assert choices(spec(photo, strokes=200)) == IN_LAYERS


def test_a_real_easel_has_the_brushes_of_its_record(photo: Path, tmp_path: Path) -> None:
    order = EaselOrder("virtual", spec(photo).canvas, ("broad", "medium"), 0, tmp_path)
    opened = open_easel(order)
    try:
        record = tmp_path / "calibration.json"
        opened.easel.calibration.save(record)
    finally:
        opened.close()
    on_it = spec(photo, strokes=200, robot="human", calibration=record)
    assert choices(on_it) == [IN_LAYERS[1], "broad", "medium"]


@pytest.mark.parametrize(
    ("given", "fault"),
    [
        ({"brushes": "auto,fine"}, "leaves them to the planner"),
        ({"brushes": "auto:50%,fine:50%"}, "leaves them to the planner"),
        ({"layers": 3}, "leave out one"),
    ],
)
def test_what_is_both_chosen_and_named_is_refused(photo: Path, given: dict[str, object], fault: str) -> None:
    with pytest.raises(ConfigError, match=fault):
        spec(photo, strokes=200, **given)


def test_brushes_that_nobody_calibrated_are_not_chosen(photo: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    record = type("Record", (), {"brush": "flat", "others": {}})()
    monkeypatch.setattr(settle.Calibration, "load", lambda path: record)
    with pytest.raises(ConfigError, match="the calibration record knows flat"):
        choices(spec(photo, strokes=200, robot="human", calibration=photo))
