"""Geometry of taught strokes: one path for planner, machine and export, and plans that keep it."""

import dataclasses
import json
import math

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from frida_painter.brush.kinds import FINE, stroke_path
from frida_painter.canvas_size import CanvasSize
from frida_painter.errors import FamilyError, PlanError
from frida_painter.report.vector import bezier_paths, svg, table
from frida_painter.strokes.family import CODE_REACH, Taught
from frida_painter.strokes.palette import Palette
from frida_painter.strokes.plan import Plan
from frida_painter.strokes.strokes import StrokeLimits, Strokes
from marks import wave_family

SIZE = CanvasSize(0.3, 0.2)
FAMILY = wave_family()
LIMITS = StrokeLimits(FAMILY.size, (0.0, 0.0), FAMILY)


def taught(count: int, seed: int = 0) -> Strokes:
    luck = torch.Generator().manual_seed(seed)
    part = torch.rand(count, 7, generator=luck)
    strokes = Strokes(
        part[:, :2] * torch.tensor([SIZE.width, SIZE.height]),
        6 * part[:, 2] - 3,
        FAMILY.size[0] + part[:, 3] * (FAMILY.size[1] - FAMILY.size[0]),
        torch.zeros(count),
        part[:, 4],
        torch.zeros(count, 3),
        Taught.of(FAMILY, CODE_REACH * (2 * part[:, 5:6] - 1)),
    )
    return strokes.project(LIMITS, SIZE)


def plain(count: int) -> Strokes:
    one = torch.ones(count)
    return Strokes(torch.full((count, 2), 0.05), one, 0.02 * one, 0.001 * one, one / 2, torch.zeros(count, 3))


def test_a_path_starts_at_its_place_and_has_the_size_of_its_stroke():
    mean = dataclasses.replace(taught(1), taught=Taught.of(FAMILY, torch.zeros(1, 1)))
    path = mean.path(torch.linspace(0, 1, 400))[0]
    torch.testing.assert_close(path[0], mean.position[0])
    assert float(torch.cdist(path, path).amax()) == pytest.approx(float(mean.length), rel=0.02)


@given(st.integers(0, 1000))
@settings(max_examples=20, deadline=None)
def test_projected_strokes_stay_on_the_canvas_and_a_second_projection_changes_nothing(seed):
    strokes = taught(5, seed)
    strokes.check(LIMITS, SIZE)
    path = strokes.path(torch.linspace(0, 1, 65))
    assert float(path.amin()) >= -1e-6
    assert float((path - torch.tensor([SIZE.width, SIZE.height])).amax()) <= 1e-6
    again = strokes.project(LIMITS, SIZE)
    torch.testing.assert_close(again.position, strokes.position, atol=1e-6, rtol=0)


def test_the_machine_and_the_export_follow_the_same_path():
    strokes = taught(3)
    for index, curves in enumerate(bezier_paths(strokes)):
        position, pressure = stroke_path(strokes, index, step=0.001)
        assert np.linalg.norm(np.diff(position, axis=0), axis=1).max() <= 0.001
        assert 0 <= pressure.min() <= pressure.max() <= float(strokes.thickness[index]) + 1e-6
        t = torch.linspace(0, 1, 30)[:, None, None]
        b = curves.double()
        drawn = (1 - t) ** 3 * b[:, 0] + 3 * t * (1 - t) ** 2 * b[:, 1] + 3 * t**2 * (1 - t) * b[:, 2] + t**3 * b[:, 3]
        apart = torch.cdist(torch.from_numpy(position), drawn.flatten(0, 1))
        assert float(apart.amin(1).amax()) < 3e-4


def test_brushes_own_strokes_and_taught_ones_are_joined_and_parted():
    joined = Strokes.join(plain(2), taught(3), plain(1))
    assert joined.taught is not None
    assert joined.taught.number.tolist() == [-1, -1, 0, 0, 0, -1]
    assert joined[:2].taught is None
    assert joined[[3, 0]].taught.number.tolist() == [0, -1]
    fraction = torch.linspace(0, 1, 9)
    torch.testing.assert_close(joined.path(fraction)[2:5], taught(3).path(fraction))
    torch.testing.assert_close(joined.path(fraction)[:2], plain(2).path(fraction))


def a_plan() -> Plan:
    paint = torch.zeros(3, dtype=torch.int64)
    colors = Palette(torch.tensor([[0.1, 0.2, 0.3]]))
    first = Plan.of(plain(3), colors, paint, canvas=SIZE, brush="fine", limits=FINE.limits)
    return first.under(Plan.of(taught(3), colors, paint, canvas=SIZE, brush="fine", limits=LIMITS))


def test_a_plan_keeps_its_families(tmp_path):
    plan = a_plan()
    plan.save(tmp_path / "plan.json")
    again = Plan.load(tmp_path / "plan.json")
    assert (again.digest, again.kinds, again.brushes) == (plan.digest, ("fine", "fine+wave"), ("fine",))
    assert again.families == (FAMILY,) and len({wave_family(), *again.families}) == 1
    torch.testing.assert_close(again.strokes.path(torch.linspace(0, 1, 9)), plan.strokes.path(torch.linspace(0, 1, 9)))
    assert json.loads((tmp_path / "plan.json").read_text())["version"] == 4
    code = plan.strokes.taught.code.clone()
    code[4] = 0.9 * code[4]
    bent = dataclasses.replace(plan.strokes, taught=dataclasses.replace(plan.strokes.taught, code=code))
    assert dataclasses.replace(plan, strokes=bent).digest != plan.digest


def test_a_plan_without_families_is_the_file_of_version_3(tmp_path):
    plan = a_plan().part(slice(0, 3))
    dataclasses.replace(plan, layers=plan.layers[:1]).save(tmp_path / "plan.json")
    record = json.loads((tmp_path / "plan.json").read_text())
    assert record["version"] == 3 and "families" not in record


def test_a_layer_refuses_strokes_of_another_family():
    other = wave_family("other")
    with pytest.raises(PlanError, match="families wave are in a layer of the family other"):
        taught(2).check(StrokeLimits(other.size, (0.0, 0.0), other), SIZE)


def test_exports_name_the_family():
    plan = a_plan()
    drawing = svg(plan, torch.full((6,), 0.004))
    assert drawing.count('data-family="wave"') == 3
    rows = table(plan).splitlines()
    assert rows[0].endswith("family,code1,code2")
    assert len({row.count(",") for row in rows}) == 1
    assert rows[1].endswith(",,,")
    assert ",wave," in rows[6]


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"name": "no spaces"}, "a letter and up to 31"),
        ({"size": (0.05, 0.02)}, "give a range within"),
        ({"mean": torch.full((20, 3), math.nan)}, "trajectory of shape"),
        ({"modes": torch.zeros(3, 20, 3)}, "modes of shape"),
    ],
)
def test_a_family_with_an_invalid_part_is_refused(change, words):
    with pytest.raises(FamilyError, match=words):
        dataclasses.replace(FAMILY, **change)


def test_slopes_of_the_path_are_those_of_its_values():
    strokes = taught(2).to(torch.float64)
    fraction = torch.linspace(0, 1, 5, dtype=torch.float64)

    def path(length, code):
        return dataclasses.replace(strokes, length=length, taught=Taught.of(FAMILY, code)).path(fraction)

    assert torch.autograd.gradcheck(path, (strokes.length.requires_grad_(), strokes.taught.code.requires_grad_()))
