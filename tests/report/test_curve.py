import itertools
import math
import re
from xml.etree import ElementTree

import pytest
from hypothesis import given
from hypothesis import strategies as st

from frida_painter.report.page import curve_svg


def falling(name: str, count: int = 100, start: int = 0) -> tuple[str, list[tuple[int, float]]]:
    return name, [(start + i, 0.2 * math.exp(-i / 20) + 0.01) for i in range(count)]


def lines(svg: str) -> list[list[tuple[float, float]]]:
    found = re.findall(r'points="([^"]*)"', svg)
    return [[tuple(map(float, pair.split(","))) for pair in points.split()] for points in found]


def test_a_falling_loss_goes_down_and_to_the_right() -> None:
    (points,) = lines(curve_svg([falling("first plan")]))
    assert all(a[0] < b[0] and a[1] <= b[1] for a, b in itertools.pairwise(points))


def test_phases_follow_each_other_from_left_to_right_whatever_their_iterations_count_from() -> None:
    first, second = lines(curve_svg([falling("first plan"), falling("after 60 strokes", 30, start=500)]))
    assert first[-1][0] == pytest.approx(second[0][0], abs=0.2)
    assert first[0][1] == pytest.approx(second[0][1], abs=0.2)  # one scale for all


def test_it_is_described_and_its_names_are_text() -> None:
    svg = curve_svg([falling("<script>&"), falling("b")])
    assert "<script>" not in svg and "&lt;script&gt;&amp;" in svg
    assert ElementTree.fromstring(svg).attrib["aria-label"].startswith("Loss over iterations: from 0.21")


@pytest.mark.parametrize("loss", [(), ((0, 1.0),), ((0, math.nan), (1, math.inf), (2, 0.0), (3, -1.0), (4, 0.5))])
def test_nothing_to_draw_draws_nothing(loss: tuple[tuple[int, float], ...]) -> None:
    assert curve_svg([("empty", loss)]) == "" == curve_svg([])


def test_thousands_of_points_stay_small_and_keep_their_end() -> None:
    svg = curve_svg([falling("long", 50_000)])
    assert len(svg) < 20_000
    assert lines(svg)[0][-1][0] == pytest.approx(944, abs=0.2)


@given(st.lists(st.lists(st.floats(), max_size=30), max_size=12))
def test_any_losses_give_a_picture_within_its_frame(losses: list[list[float]]) -> None:
    svg = curve_svg([(f"phase {i}", list(enumerate(values))) for i, values in enumerate(losses)])
    if svg:
        ElementTree.fromstring(svg)
        assert all(0 <= x <= 960 and 0 <= y <= 360 for points in lines(svg) for x, y in points)
