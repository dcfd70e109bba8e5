"""Strokes as a sequence, an array and a table; plans that are edited and shown."""

import io
import sys
from dataclasses import replace
from types import ModuleType
from typing import Any

import numpy as np
import pytest
import torch
from PIL import Image

import frida_painter as fp
from frida_painter.errors import ConfigError, PlanError
from frida_painter.strokes.strokes import COLUMNS
from support.planning import picture
from support.plans import made_up_plan, made_up_strokes


def test_strokes_are_a_sequence() -> None:
    strokes = made_up_strokes(5)
    assert len(strokes[0]) == 1 and torch.equal(strokes[-1].position, strokes.position[4:])
    assert torch.equal(fp.Strokes.join(*strokes).color, strokes.color)
    assert [float(one.length) for one in strokes] == pytest.approx(strokes.length.tolist())
    assert torch.equal(strokes[np.array([3, 1])].angle, strokes.angle[[3, 1]])
    assert torch.equal(strokes[np.array([True, False, True, False, False])].angle, strokes.angle[[0, 2]])
    assert torch.equal(strokes[torch.tensor(2)].angle, strokes.angle[2:3])
    for beyond in (5, -6):
        with pytest.raises(IndexError, match=f"Stroke {beyond} was asked for; there are 5"):
            strokes[beyond]
    assert list(fp.Strokes.empty()) == []


def test_strokes_are_an_array_and_come_back() -> None:
    strokes = made_up_strokes(4)
    rows = np.asarray(strokes)
    assert rows.shape == (4, 9) and rows.dtype == np.float32
    assert np.asarray(strokes, np.float64).dtype == np.float64
    back = fp.Strokes.from_array(rows)
    assert all(torch.equal(one, back.arrays()[name]) for name, one in strokes.arrays().items())
    assert np.asarray(fp.Strokes.empty()).shape == (0, 9)
    assert len(fp.Strokes.from_array(np.zeros((0, 9)))) == 0
    for wrong in (np.zeros((3, 8)), np.zeros(9), np.full((1, 9), np.nan)):
        with pytest.raises(PlanError, match=r"it is \[n, 9\] finite numbers: x, y, angle"):
            fp.Strokes.from_array(wrong)


def test_strokes_are_a_table(monkeypatch: pytest.MonkeyPatch) -> None:
    strokes = made_up_strokes(3)
    made: dict[str, Any] = {}
    pandas = ModuleType("pandas")
    pandas.DataFrame = lambda rows, columns: made.update(rows=rows, columns=columns) or made  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "pandas", pandas)
    strokes.to_frame()
    assert made["columns"] == list(COLUMNS) and np.array_equal(made["rows"], np.asarray(strokes))
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(ConfigError, match=r'the extra "table".*pandas'):
        strokes.to_frame()


def test_pandas_itself_takes_them() -> None:
    pandas = pytest.importorskip("pandas")
    frame = made_up_strokes(3).to_frame()
    assert isinstance(frame, pandas.DataFrame) and list(frame) == list(COLUMNS)
    assert len(fp.Strokes.from_array(frame)) == 3


def test_what_is_printed_is_short() -> None:
    plan = made_up_plan(50)
    for shown in (plan, plan.strokes, plan.palette, fp.make_goal(picture())):
        assert len(repr(shown)) < 260 and "tensor(" not in repr(shown), repr(shown)
    assert repr(fp.Strokes.empty()) == "Strokes(0)"


def test_a_notebook_shows_a_plan() -> None:
    strange = made_up_plan(5)  # of a medium brush, which ships with the project
    assert replace(strange, layers=(replace(strange.layers[0], brush="strange"),))._repr_png_() is None
    content = made_up_plan(5)._repr_png_()
    assert content is not None
    with Image.open(io.BytesIO(content)) as shown:
        assert shown.height == 360


def test_an_edited_plan_stays_within_its_limits() -> None:
    plan = made_up_plan(20)
    longer = plan.edit(length=plan.strokes.length * 100)
    limits = plan.layers[0].limits.within(plan.canvas)
    assert float(longer.strokes.length.max()) <= limits.length[1] + 1e-6
    assert torch.equal(longer.paint, plan.paint)
    same = plan.edit(length=plan.strokes.length)
    assert torch.allclose(same.strokes.position, plan.strokes.position, atol=1e-6)
    turned = plan.edit(angle=0.0, thickness=np.full(20, 0.5), position=plan.strokes.position.tolist())
    assert bool((turned.strokes.angle == 0).all()) and bool((turned.strokes.thickness == 0.5).all())
    dark = plan.edit(color=[0.0, 0.0, 0.0])
    assert len(set(dark.paint.tolist())) == 1
    other = plan.edit(palette=["#808080"] * len(plan.palette))
    assert bool((other.strokes.color - 0.5).abs().max() < 0.01)


@pytest.mark.parametrize(
    ("values", "says"),
    [
        ({"length": torch.ones(3)}, "length was given in the shape"),
        ({"bend": float("nan")}, "not finite"),
        ({"position": "here"}, "position was given"),
        ({"palette": ["#000000"]}, "A palette of 1 paints"),
    ],
)
def test_a_wrong_edit_is_refused(values: dict[str, Any], says: str) -> None:
    with pytest.raises(PlanError, match=says):
        made_up_plan(20).edit(**values)
