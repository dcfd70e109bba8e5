"""Marks are cut out of the way of a guided tip by its height."""

import math

import numpy as np
import pytest

from frida_painter.errors import FamilyError
from frida_painter_calibration.teaching.marks import MarkCutter, read_marks

PRESS = 0.005


def led(cutter, *heights, length=0.03, start=(0.1, 0.05), at=0.0):
    """Leads the tip along x, at these heights in millimetres, 1 ms from one to the next."""
    for number, height in enumerate(heights):
        x = start[0] + length * number / max(1, len(heights) - 1)
        cutter.add(np.array([x, start[1]]), height / 1000, at + number / 1000)


def a_mark(samples=40, tremor=()):
    """Down from above, along the canvas, and up again; `tremor` are heights within."""
    middle = np.full(samples, -2.5)
    middle[samples // 2 : samples // 2 + len(tremor)] = tremor
    return [8, 5, 3, 1, -0.5, *middle, -0.5, 0.5, 1.5, 3, 8]


def test_each_touch_is_a_mark_with_its_place_pressure_and_time(tmp_path):
    cutter = MarkCutter(PRESS)
    for number in range(3):
        led(cutter, *a_mark(), start=(0.1, 0.05 + 0.02 * number), at=2.0 * number)
    cutter.finish()
    assert cutter.save(tmp_path / "marks.json") == []
    marks = read_marks(tmp_path / "marks.json")
    assert len(marks) == 3
    for number, mark in enumerate(marks):
        assert mark.place[:, 1] == pytest.approx(0.05 + 0.02 * number)
        assert mark.pressure.max() == pytest.approx(0.5) and mark.pressure[0] == pytest.approx(0.1)
        assert 0.02 < mark.size < 0.03 and mark.seconds == pytest.approx(0.041, abs=0.002)


@pytest.mark.parametrize(("tremor", "marks"), [((0.5, 1.5, 0.5), 1), ((1.0, 2.5, 1.0), 2)])
def test_a_hand_that_trembles_does_not_cut_a_mark_and_a_lift_does(tmp_path, tremor, marks):
    cutter = MarkCutter(PRESS)
    led(cutter, *a_mark(80, tremor), length=0.06)
    assert len(cutter.marks) == marks
    cutter.save(tmp_path / "marks.json")
    assert len(read_marks(tmp_path / "marks.json")) == marks


def test_a_hand_that_rests_adds_no_way(tmp_path):
    chance = np.random.default_rng(0)
    cutter = MarkCutter(PRESS)
    for sample in range(20_000):  # six minutes at 50 a second, with the noise of the joints' encoders
        cutter.add(np.array([0.1, 0.1]) + chance.normal(0, 3e-5, 2), -0.001, sample / 50)
    led(cutter, *[-2.0] * 60, 5.0, start=(0.1, 0.1), at=400.0)
    (mark,) = cutter.marks
    way = float(np.linalg.norm(np.diff(mark[:, :2], axis=0), axis=1).sum())
    assert way == pytest.approx(0.03, rel=0.1)
    assert cutter.save(tmp_path / "marks.json") == []


def test_deeper_than_the_hardest_press_is_the_hardest(tmp_path):
    cutter = MarkCutter(PRESS)
    led(cutter, 5, *[-10.0] * 30, *[-5.0] * 30, 5)
    cutter.save(tmp_path / "marks.json")
    (mark,) = read_marks(tmp_path / "marks.json")
    assert sorted(set(np.round(mark.pressure, 3))) == [0.5, 1.0]


def test_a_tap_is_left_out_and_told(tmp_path):
    cutter = MarkCutter(PRESS)
    led(cutter, 5, -1, -1, -1, -1, -1, 5, length=0.001)
    led(cutter, *a_mark())
    led(cutter, *a_mark(900), length=0.9)
    told = cutter.save(tmp_path / "marks.json")
    assert len(told) == 2 and "Touch 1 has 3 points" in told[0] and "mm large" in told[1] and "Touch 3" in told[1]
    assert len(read_marks(tmp_path / "marks.json")) == 1


def test_an_arm_that_never_came_down_is_told(tmp_path):
    cutter = MarkCutter(PRESS)
    led(cutter, 20, 10, 5, 10)
    cutter.add(np.array([0.1, 0.1]), math.nan, 1.0)
    cutter.finish()
    with pytest.raises(FamilyError, match="0 touches of the canvas were recorded, and 0 of them are marks; guide"):
        cutter.save(tmp_path / "marks.json")
    assert not list(tmp_path.iterdir())
