import torch

from frida_painter.frames import PixelGrid
from frida_painter.objectives.kinds.image import ImageTerm
from frida_painter.objectives.objective import ObjectiveContext
from frida_painter.objectives.replication import bareness
from networks import NoEncoderRegistry
from scenes import CANVAS

GRID = PixelGrid.of_height(CANVAS, 24)
PALE = torch.ones(3, GRID.rows, GRID.columns)
PALE[:2, :12] = 0.88  # a pale sky above paper


def test_what_is_bare_counts_only_where_the_picture_is_no_paper_and_whatever_the_colour() -> None:
    left = bareness(PALE, GRID)
    paper = torch.ones_like(PALE)
    assert abs(float(left(paper)) - 0.5) < 0.02 and float(left(PALE)) < 1e-3
    half = PALE.clone()
    half[:, :6] = 1
    assert abs(float(left(half)) - 0.25) < 0.02
    other = paper.clone()
    other[2, :12] = 0.6  # another colour is no bare canvas
    assert float(left(other)) < 1e-3
    dark = bareness(PALE - 0.5 * (PALE < 0.9), GRID)
    assert abs(float(dark(paper)) - 0.5) < 0.02, "a pale sky and a dark one are as bare"


def test_its_slope_is_that_of_finite_differences() -> None:
    left = bareness(PALE.double(), GRID)
    value = torch.tensor([[[0.95]]]).double().requires_grad_()
    assert torch.autograd.gradcheck(lambda one: left(one.expand(3, GRID.rows, GRID.columns)), (value,))


def test_a_picture_with_a_price_on_bare_canvas_prefers_the_covered_one() -> None:
    context = ObjectiveContext(GRID, NoEncoderRegistry(), 0)
    priced, free = (ImageTerm(PALE, bare=price).prepare(context).objective for price in (0.05, 0.0))
    bare, covered = PALE.clone(), PALE.clone()
    bare[:, :12] = 1
    covered[:2, :12] = 0.7  # too dark by more than paper is too light
    assert float(free(bare)) < float(free(covered)) and float(priced(bare)) > float(priced(covered))
    assert torch.isfinite(priced(torch.ones_like(PALE)))
