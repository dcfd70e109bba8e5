import torch

from frida_painter.objectives.style import Style
from support.networks import QuickVgg
from support.planning import picture


def style_of(image: torch.Tensor, seed: int = 0) -> Style:
    return Style(image, QuickVgg(), seed)


def test_a_picture_has_its_own_style_and_another_has_not() -> None:
    image = picture(64, 86)
    style = style_of(image)
    with torch.no_grad():
        own, turned, other = float(style(image)), float(style(image.flip(2))), float(style(1 - image))
    assert own < 0.2 * other
    assert turned < 0.5 * other, "what lies elsewhere is in the same style"


def test_colors_alone_matter_too() -> None:
    image = picture(64, 86)
    style = style_of(image)
    with torch.no_grad():
        assert float(style(image[[2, 1, 0]])) > 5 * float(style(image))


def test_descending_it_brings_the_style_nearer() -> None:
    style = style_of(picture(48, 64))
    image = torch.full((3, 48, 64), 0.5, requires_grad=True)
    adam = torch.optim.Adam([image], lr=0.05)
    start = float(style(image).detach())
    for _ in range(6):
        adam.zero_grad()
        style(image).backward()
        adam.step()
    assert float(style(image).detach()) < 0.8 * start


def test_the_same_seed_looks_at_the_same_places() -> None:
    image, other = picture(64, 86), picture(40, 60)
    with torch.no_grad():
        assert float(style_of(image, 1)(other)) == float(style_of(image, 1)(other))
        assert float(style_of(image, 1)(other)) != float(style_of(image, 2)(other))


def test_what_is_free_of_the_style_does_not_count() -> None:
    image = picture(64, 86)
    free = torch.zeros(8, 10)
    free[:, 5:] = 1
    changed = image.clone()
    changed[:, :, 48:] = 1 - changed[:, :, 48:]
    losses = []
    for places in (free, None):
        style = Style(image, QuickVgg(), 0, free=places)
        with torch.no_grad():
            losses.append(float(style(changed)) - float(style(image)))
    assert losses[0] < 0.3 * losses[1]
