"""Marks of a hand become families; bad marks are refused with one sentence."""

import json
import math

import numpy as np
import pytest
import torch

from frida_painter.brush.kinds import FINE
from frida_painter.brush.weights import load_stroke_model
from frida_painter.errors import FamilyError, WeightsError
from frida_painter_calibration.teaching.families import (
    FamilyField,
    FamilyRibbon,
    load_family,
    load_family_model,
    read_family,
    write_family,
)
from frida_painter_calibration.teaching.marks import TaughtMark, align_marks, held_out_error, learn_family, read_marks
from support.hand_marks import FAMILIES, make_marks

LINE = {"x": [0, 5, 10, 20], "y": [0, 1, 0, 2], "pressure": [0.2, 0.8, 0.8, 0.2]}


def written(folder, content, name="marks.json"):
    path = folder / name
    path.write_text(content if isinstance(content, str) else json.dumps(content))
    return path


def test_the_same_marks_from_json_csv_and_a_folder(tmp_path):
    marks = [LINE, {**LINE, "y": [0, 2, 0, 1]}]
    whole = read_marks(written(tmp_path, {"unit": "mm", "marks": marks}))
    lists = [[list(point) for point in zip(*mark.values(), strict=True)] for mark in marks]
    points = read_marks(written(tmp_path, {"marks": lists}, "lists.json"))
    rows = [
        f"{number},{x},{y},{p}" for number, mark in enumerate(marks) for x, y, p in zip(*mark.values(), strict=True)
    ]
    table = read_marks(written(tmp_path, "\n".join(("mark,x_mm,y_mm,pressure", *rows)), "marks.csv"))
    for other in (points, table):
        assert len(other) == 2
        for one, two in zip(whole, other, strict=True):
            np.testing.assert_allclose(one.place, two.place)
            np.testing.assert_allclose(one.pressure, two.pressure)
    assert len(read_marks(tmp_path)) == 6
    assert whole[0].size == pytest.approx(math.hypot(0.02, 0.002))


def test_heights_become_pressures(tmp_path):
    path = written(tmp_path, {"x": [0, 5, 10, 15, 20, 25], "y": [0] * 6, "height": [2, -1, -4, -4, -1, 3]})
    assert read_marks(path)[0].pressure.tolist() == [0, 0.25, 1, 1, 0.25, 0]


@pytest.mark.parametrize(
    ("mark", "words"),
    [
        ({"x": [1], "y": [1]}, "has 1 point on the canvas"),
        ({"x": list(range(10_000)), "y": [0] * 10_000}, "10,000 points; a mark has at most 5,000: keep every 2. point"),
        ({"x": [0, None, 2, 3], "y": [0, 0, 0, 0]}, "a place that is not a number"),
        ({**LINE, "pressure": [0.1, math.nan, 0.2, 0.1]}, "a pressure that is not a number"),
        ({**LINE, "pressure": [0.1, 2.0, 0.2, 0.1]}, "a pressure that is not a number from 0 to 1"),
        ({"x": [0, 5, 10, 12, 15, 20], "y": [0] * 6, "pressure": [1, 1, 0, 0, 1, 1]}, "lifts the brush in its middle"),
        ({"x": [0, 500, 800, 900], "y": [0, 0, 0, 0]}, "900.0 mm large; a mark is from 3 to 500"),
        ({"x": [0, 5e6, 8, 9], "y": [0, 0, 0, 0]}, "within 10 m"),
        ({"x": [0, 5, 8], "y": [0, 0, 0, 0]}, "holds no marks"),
        ({"x": [0, 5, 8, 9], "y": [0, 0, 0, 0], "height": [1, 1, 1, 1]}, "never goes below the canvas"),
        ("no json", "holds no marks"),
        ([[0, 0], [1, 1, 1]], "holds no marks"),
        ({"marks": [7]}, "holds no marks"),
    ],
)
def test_a_bad_mark_is_refused_in_one_sentence(tmp_path, mark, words):
    path = written(tmp_path, mark)
    with pytest.raises(FamilyError) as refused:
        read_marks(path)
    assert words in str(refused.value)
    assert "marks.json" in str(refused.value)
    assert str(refused.value).count(". ") <= 1  # "every 2. point" is no end of a sentence


def test_few_marks_and_marks_that_are_nothing_alike_are_refused():
    marks = make_marks("comma", 9)
    with pytest.raises(FamilyError, match="9 marks were given; a family is learned from 10"):
        learn_family(marks, "comma")
    luck = np.random.default_rng(0)
    wild = [TaughtMark(np.cumsum(luck.normal(0, 0.01, (40, 2)), 0), np.ones(40)) for _ in range(12)]
    with pytest.raises(FamilyError, match="nothing alike"):
        learn_family(wild, "wild")


def test_place_turn_and_size_of_marks_do_not_matter():
    marks = make_marks("zigzag", 12)
    family = learn_family(marks, "zigzag")
    luck = np.random.default_rng(1)
    moved = []
    for mark in marks:
        turn = np.exp(1j * luck.uniform(-3, 3)) * luck.uniform(0.7, 1.4)
        place = (mark.place[:, 0] + 1j * mark.place[:, 1]) * turn + 0.2
        moved.append(TaughtMark(np.stack((place.real, place.imag), 1), mark.pressure))
    other = learn_family(moved, "zigzag", size=family.size)
    assert other.codes == family.codes
    torch.testing.assert_close(other.mean, family.mean, atol=2e-3, rtol=0)


@pytest.mark.parametrize("name", FAMILIES)
def test_a_code_explains_held_out_marks_better_than_the_mean_mark(name):
    aligned, _ = align_marks(make_marks(name, 14, seed=3))
    mean = np.mean([np.linalg.norm((aligned.mean(0) - one)[:, :2], axis=1).mean() for one in aligned])
    assert held_out_error(aligned, 2) < 0.8 * mean


@pytest.mark.parametrize("name", FAMILIES)
def test_the_projects_families_come_with_a_learned_model_for_the_fine_brush(name):
    family, model = load_family(name), load_stroke_model(f"fine+{name}")
    assert isinstance(model, FamilyField)
    assert (model.family, model.brush, family.name) == (family, "fine", name)
    assert 0 < model.spread.share < 1
    ribbon = load_stroke_model(f"broad+{name}")
    assert isinstance(ribbon, FamilyRibbon)
    assert ribbon.limits.family == family


def test_a_family_file_is_read_back_and_a_foreign_one_refused(tmp_path):
    family = learn_family(make_marks("comma", 10), "mine")
    write_family(tmp_path / "mine.safetensors", family)
    assert read_family(tmp_path / "mine.safetensors") == family
    assert isinstance(load_family_model(tmp_path / "mine.safetensors", "fine"), FamilyRibbon)
    field = FamilyField("fine", (kind := FINE.of_family(family)).frame, kind.limits)
    field.save(tmp_path / "learned.safetensors")
    assert load_family_model(tmp_path / "learned.safetensors", "fine").family == family
    assert isinstance(load_family_model(tmp_path / "learned.safetensors", "medium"), FamilyRibbon)
    (tmp_path / "torn.safetensors").write_bytes((tmp_path / "mine.safetensors").read_bytes()[:-7])
    for name in ("torn.safetensors", "none.safetensors", "nothing"):
        with pytest.raises((FamilyError, WeightsError)):
            load_family(tmp_path / name if "." in name else name)
