"""Words in a style: a thing laid into it."""

import pytest
import torch

from frida_painter.palette import to_lab
from frida_painter.words.style_scene import composite_into_style


def _halves() -> torch.Tensor:
    """Blue on the left, pale yellow on the right, with a busy stripe of bars along the top."""
    picture = torch.empty(3, 96, 128)
    picture[:, :, :64] = torch.tensor([0.1, 0.2, 0.6])[:, None, None]
    picture[:, :, 64:] = torch.tensor([0.95, 0.9, 0.6])[:, None, None]
    picture[:, :24] = (torch.arange(128) // 16 % 2).float()
    return picture


def _thing() -> torch.Tensor:
    thing = torch.ones(4, 30, 30)
    thing[0] = 0.9
    thing[1:3] = 0.1
    thing[:3, 10:20, 10:20] = 0.0
    return thing


@pytest.mark.slow
def test_a_thing_is_seen_in_the_pictures_own_colours() -> None:
    picture = _halves()
    shown, where = composite_into_style(_thing(), picture)
    inside = where > 0.5
    assert torch.equal(shown[:, ~inside & (where == 0)], picture[:, ~inside & (where == 0)])
    assert 0.2 < float(inside.float().mean()) < 0.6, "large"
    around = torch.nn.functional.max_pool2d(inside[None, None].float(), 9, 1, 4)[0, 0].bool() & ~inside
    light = to_lab(shown.permute(1, 2, 0))[..., 0]
    assert abs(float(light[inside].median() - light[around].mean())) > 15, "it stands out"
    chosen = to_lab(shown[:, inside].T)
    own = to_lab(picture.flatten(1).T)
    assert float(torch.cdist(chosen[::50], own).amin(1).median()) < 15, "of the picture"


@pytest.mark.slow
def test_it_lies_where_the_picture_is_calm() -> None:
    rows = (composite_into_style(_thing(), _halves())[1] > 0.5).any(1).nonzero().flatten()
    assert int(rows[0]) >= 6


def test_named_colours_are_kept() -> None:
    shown, where = composite_into_style(_thing(), _halves(), own=1.0)
    body = shown[:, where > 0.99]
    assert float((body[0] > 0.85).float().mean()) > 0.7


@pytest.mark.parametrize(("rows", "first", "last"), [((0.0, 0.3), 0, 60), ((0.7, 1.0), 36, 96)])
def test_it_has_one_of_the_given_sizes_in_the_given_rows(rows: tuple[float, float], first: int, last: int) -> None:
    where = composite_into_style(_thing(), _halves(), own=1.0, sizes=(0.3,), rows=rows)[1] > 0.5
    down, across = where.any(1).nonzero().flatten(), where.any(0).nonzero().flatten()
    assert abs(len(down) - 0.3 * 96) <= 1 and abs(len(across) - 0.3 * 96) <= 1
    assert first <= int(down[0]) and int(down[-1]) < last
