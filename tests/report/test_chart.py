import matplotlib
import numpy as np
import pytest
import torch

from frida_painter.report.chart import Series, chart, log_ticks

BLUE = torch.tensor([0, 114, 178])[:, None, None] / 255
ORANGE = torch.tensor([213, 94, 0])[:, None, None] / 255


def where(picture: torch.Tensor, color: torch.Tensor) -> torch.Tensor:
    """Rows and columns [n, 2] of the plotting area that have exactly that colour."""
    return torch.nonzero((picture[:, 100:480, :750] - color).abs().amax(0) < 0.01)


def test_a_rising_line_rises_on_the_picture():
    found = where(chart("t", "x", "y", [Series("a", (0, 1), (0.0, 5.0))]), BLUE).double()
    left, right = (found[found[:, 1] == column][:, 0].mean() for column in (150, 650))
    assert len(found) > 600 and left > right + 150


def test_a_higher_line_lies_above_and_both_are_there():
    picture = chart("t", "x", "y", [Series("a", (0, 1), (1.0, 1.0)), Series("b", (0, 1), (3.0, 3.0))])
    assert where(picture, ORANGE)[:, 0].double().mean() < where(picture, BLUE)[:, 0].double().mean() - 100


def test_on_a_logarithmic_axis_equal_factors_are_equal_steps():
    lines = [Series(name, (0, 1), (value, value)) for name, value in (("a", 0.01), ("b", 0.1))]
    middle = Series("c", (0, 1), (10**-1.5, 10**-1.5))
    picture = chart("t", "x", "y", [*lines, middle], logarithmic=True)
    a, b, c = (
        where(picture, color)[:, 0].double().median()
        for color in (BLUE, ORANGE, torch.tensor([0, 138, 100])[:, None, None] / 255)
    )
    assert float(c) == pytest.approx(float(a + b) / 2, abs=1.5)


@pytest.mark.parametrize("band", [True, False])
def test_what_may_be_off_is_drawn_from_low_to_high(band):
    x = tuple(np.linspace(0, 1, 5))
    plain = Series("a", x, (1.0,) * 5)
    off = Series("a", x, (1.0,) * 5, (0.5,) * 5, (1.5,) * 5, band=band)
    with_top = Series("b", x, (2.0,) * 5)
    first, second = (chart("t", "x", "y", [series, with_top]) for series in (plain, off))
    changed = torch.nonzero((first - second).abs().amax(0) > 0.02)
    height = int(changed[:, 0].max() - changed[:, 0].min())
    assert height == pytest.approx((540 - 104 - 66) / 2.12, abs=8)  # of a y axis from 0 to 2.12


def test_words_of_lines_that_end_together_do_not_cover_each_other():
    picture = chart("t", "x", "y", [Series("aaaa", (0, 1), (1.0, 1.0)), Series("bbbb", (0, 1), (1.0, 1.001))])
    labels = picture[:, :, 755:]
    blue, orange = (torch.nonzero((labels - color).abs().amax(0) < 0.05)[:, 0] for color in (BLUE, ORANGE))
    assert int(orange.max()) < int(blue.min())


@pytest.mark.parametrize(("least", "most"), [(0.008, 0.0152), (0.02, 0.045), (0.001, 0.8), (0.5, 0.52)])
def test_lines_of_a_logarithmic_axis_lie_between_its_ends_about_evenly(least, most):
    ticks = np.array(log_ticks(least, most))
    steps = np.diff(np.log10(ticks))
    assert 3 <= len(ticks) <= 10 and least <= ticks[0] and ticks[-1] <= most
    assert steps.max() < 3 * steps.min()


def test_a_long_name_is_written_whole():
    named = "placement known, without looking"
    picture = chart("t", "x", "y", [Series(named, (0, 1), (1.0, 2.0))])
    ink = torch.nonzero((picture - BLUE).abs().amax(0) < 0.05)
    assert ink[:, 1].max() < 940 - 8


def test_no_matplotlibrc_changes_a_chart_or_has_latex_run() -> None:
    """matplotlib takes a matplotlibrc from the current folder first, and a painting's folder may hold anybody's."""
    plain = chart("t", "x", "y", [Series("a", (0, 1), (0.0, 5.0))])
    with matplotlib.rc_context({"text.usetex": True, "lines.linestyle": ":", "font.size": 40}):
        assert torch.equal(chart("t", "x", "y", [Series("a", (0, 1), (0.0, 5.0))]), plain)
