"""Drawn figures: the tables are well formed, and a figure shows what its pose and its clothes say."""

import pytest
import torch

from frida_painter.words.figures import Clothes, Figure, Pose, draw_figure, nearest, poses, wardrobe
from support.networks import WordBag

PLAIN = Clothes(("somebody",), "red", "blue", "trousers")


def draw(
    words: str, worn: Clothes = PLAIN, heads: float = 7.0, *, has_seat: bool = True, is_old: bool = False
) -> Figure:
    return draw_figure(pose(words), worn, heads=heads, is_old=is_old, kind=0, has_seat=has_seat)


def pose(word: str) -> Pose:
    return next(one for one in poses() if word in one.words)


def middle(figure: Figure, channel: int) -> float:
    """Mean height of the clothes of one of the colours red and blue."""
    shown = (figure.picture[channel] > 0.5) & (figure.picture[2 - channel] < 0.3) & (figure.picture[3] > 0.9)
    rows = torch.arange(figure.picture.shape[1], 0, -1, dtype=torch.float32)[:, None].expand_as(shown)
    return float(rows[shown].mean()) / figure.picture.shape[1]


@pytest.mark.parametrize("which", poses(), ids=lambda one: one.words[0])
@pytest.mark.parametrize("heads", [4.0, 7.0])
def test_a_figure_of_every_pose_is_whole_and_its_hand_is_on_it(which: Pose, heads: float) -> None:
    figure = draw_figure(which, PLAIN, heads=heads, is_old=False, kind=1, has_seat=False)
    _, height, width = figure.picture.shape
    across, up = figure.hand
    assert -0.5 <= across <= 0.5 and 0 <= up <= 1 and 0.2 < figure.tall < 1.6 and 0 <= figure.seat < 0.8
    around = figure.picture[3, max(0, round((1 - up) * height) - 3) :, max(0, round((across + 0.5) * width) - 3) :]
    assert float(around[:7, :7].max()) == 1 or which.tool == "mallet", "which hits what is on the floor"
    assert float(figure.picture[3, :2].max()) > 0.5, "nothing is cut off, and there is no margin"
    assert (which.carried == "seat") == (figure.seat > 0)


@pytest.mark.parametrize("worn", wardrobe(), ids=lambda one: one.words[0])
def test_all_clothes_can_be_drawn(worn: Clothes) -> None:
    assert worn.cut in ("trousers", "shorts", "skirt", "robe")
    assert float(draw("standing", worn).picture[3].mean()) > 0.2


def test_poses_differ_as_their_words_do() -> None:
    upright, lying, bent = draw("standing"), draw("lying"), draw("bending")
    assert (
        lying.picture.shape[2] > 2 * lying.picture.shape[1] and upright.picture.shape[1] > 2 * upright.picture.shape[2]
    )
    assert lying.tall < 0.4 < bent.tall < upright.tall
    assert middle(upright, 0) > middle(upright, 2) + 0.2, "a shirt above trousers"
    assert draw("waving").hand[1] > 0.9 and draw("sweeping").hand[1] < 0.6, "the hand is up, or down"
    assert float(draw("jumping").picture[3, -10:].max()) == 0, "in the air"


def test_a_stool_carries_somebody_who_sits_on_nothing() -> None:
    alone, carried = (float(draw("sitting", has_seat=has_seat).picture[3].sum()) for has_seat in (False, True))
    assert alone > 1.05 * carried


def test_the_old_have_white_hair_and_children_large_heads() -> None:
    young, old = draw("standing"), draw("standing", is_old=True)
    white = [((one.picture[:3] - 0.75).abs().amax(0) < 0.02).float().sum() for one in (young, old)]
    assert white[1] > white[0] + 100
    child = draw("standing", heads=4.5)
    assert child.picture.shape[1] < 0.75 * young.picture.shape[1]
    assert child.picture.shape[2] > 0.7 * young.picture.shape[2]


def test_a_mirrored_figure_has_its_hand_on_the_other_side() -> None:
    figure = draw("climbing")
    turned = figure.mirror()
    assert turned.hand == (-figure.hand[0], figure.hand[1]) and torch.equal(turned.picture.flip(2), figure.picture)


def test_the_nearest_row_is_that_with_the_word() -> None:
    found, word, similarity = nearest(["climbing"], poses(), WordBag())
    assert found is pose("climbing") and word == "climbing" and similarity == pytest.approx(1)
