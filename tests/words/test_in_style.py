"""A scene in the colours, values and marks of a style picture."""

import pytest
import torch

from frida_painter.palette import to_lab
from frida_painter.words.compositing import in_style


def stripes(rows: int = 96, columns: int = 128) -> torch.Tensor:
    """A style: dark blue and yellow stripes, slanting."""
    down, across = torch.meshgrid(torch.arange(rows), torch.arange(columns), indexing="ij")
    light = (((down + across) // 6) % 3 == 0).float()
    dark, bright = torch.tensor([0.1, 0.15, 0.5])[:, None, None], torch.tensor([0.95, 0.85, 0.3])[:, None, None]
    return torch.lerp(dark, bright, light)


def scene() -> tuple[torch.Tensor, torch.Tensor]:
    """A brown square on bare paper, and its opacity."""
    where = torch.zeros(64, 80)
    where[20:50, 25:55] = 1.0
    picture = torch.ones(3, 64, 80)
    picture[:, where > 0] = torch.tensor([0.5, 0.35, 0.2])[:, None]
    picture[:, 28:36, 30:50] = 0.05
    return picture, where


@pytest.mark.slow
def test_a_scene_on_bare_paper_takes_on_the_colours_and_the_marks_of_a_style() -> None:
    (picture, where), style = scene(), stripes()
    shown = in_style(picture, where, style)
    assert shown.shape == picture.shape and 0 <= float(shown.min()) <= float(shown.max()) <= 1
    ground = shown[:, where == 0]
    own = to_lab(style.flatten(1).T)[::40]
    assert float(torch.cdist(to_lab(ground.T), own).amin(1).median()) < 12, "the colours of the style"
    assert float(to_lab(shown[:, where == 0].T)[:, 0].std()) > 0.5 * float(own[:, 0].std()), "and its marks"
    assert float((shown - 1).abs().amax(0).amin()) > 0.03, "no paper is left"


@pytest.mark.slow
def test_a_thing_keeps_its_light_and_dark() -> None:
    picture, where = scene()
    shown = to_lab(in_style(picture, where, stripes()).permute(1, 2, 0))[..., 0]
    assert float(shown[30:34, 34:46].mean()) < float(shown[40:46, 30:50].mean()) - 10


@pytest.mark.slow
def test_the_same_scene_is_put_together_in_the_same_way() -> None:
    assert torch.equal(in_style(*scene(), stripes()), in_style(*scene(), stripes()))


@pytest.mark.slow
@pytest.mark.parametrize("size", [(5, 5), (10, 400), (400, 10)])
def test_tiny_and_narrow_styles_serve_too(size: tuple[int, int]) -> None:
    picture, where = scene()
    shown = in_style(picture, torch.zeros_like(where), stripes(*size))  # and a scene may have no thing
    assert shown.isfinite().all()
