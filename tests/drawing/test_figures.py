"""Drawn figures: the tables are well formed, and a figure shows what its pose and its clothes say."""

from collections.abc import Sequence

import pytest
import torch

from downloads import fetched
from frida_painter.drawing.figures import Clothes, Figure, Pose, Tool, draw_figure, nearest, poses, tools, wardrobe
from frida_painter.objectives.encoders.sentence import SentenceEncoder
from frida_painter.words.reading import WordMeanings
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
    assert float(around[:7, :7].max()) == 1
    assert float(figure.picture[3, :2].max()) > 0.5, "nothing is cut off, and there is no margin"
    assert (which.carried == "seat") == (figure.seat > 0)


@pytest.mark.parametrize("worn", wardrobe(), ids=lambda one: one.words[0])
def test_all_clothes_can_be_drawn(worn: Clothes) -> None:
    assert worn.cut in ("trousers", "shorts", "skirt", "robe")
    assert float(draw("standing", worn).picture[3].mean()) > 0.2


@pytest.mark.parametrize("garment", wardrobe("garments.txt"), ids=lambda one: one.words[0])
def test_a_garment_is_seen_over_the_clothes_in_its_colour(garment: Clothes) -> None:
    plain = Clothes(("somebody",), "white", "white", "trousers")
    worn = plain.put_on(garment, "magenta")
    assert not torch.equal(draw("standing", worn).picture, draw("standing", plain).picture)
    assert (worn.top == "magenta") == (garment.bottom in ("top", "all"))
    assert (worn.bottom == "magenta") == (garment.bottom in ("bottom", "all"))
    assert garment.bottom in ("top", "bottom", "all", "-") and worn.cut in (
        "trousers",
        "shorts",
        "skirt",
        "robe",
        "coat",
    )


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
    assert turned.holds["lap"] == (-figure.holds["lap"][0], figure.holds["lap"][1])
    assert turned.hand == (-figure.hand[0], figure.hand[1]) and torch.equal(turned.picture.flip(2), figure.picture)


def test_the_nearest_row_is_that_with_the_word() -> None:
    found, word, similarity = nearest(["climbing"], poses(), WordBag())
    assert found is pose("climbing") and word == "climbing" and similarity == pytest.approx(1)


SHAPES = {"hood": 2, "area": 2, "line": 2, "ring": 1, "dabs": 1, "end": 1, "meet": 1, "body": 0, "arm": 0}


@pytest.mark.parametrize("row", [*tools(), *wardrobe(), *wardrobe("garments.txt")], ids=lambda one: one.words[0])
def test_every_shape_can_be_drawn_at_a_part_of_the_body(row: Tool | Clothes) -> None:
    for kind, *rest in row.shapes:
        points = [one for one in rest if "," in one and one[0].isalpha()]
        assert len(points) >= SHAPES[kind] and all(one[0] in "hoackfglm" for one in points)
        numbers = [one for word in rest[1:] if not word[0].isalpha() for one in word.split(",")]
        assert len(numbers) == {"line": 1, "ring": 2, "dabs": 4}.get(kind, 0) and [float(one) for one in numbers] != [0]


def use(tool: Tool | None, which: Pose, heads: float = 7.0, color: str = "") -> Figure:
    tool = tool and tool._replace(color=color or tool.color)
    return draw_figure(which, PLAIN, heads=heads, is_old=False, kind=0, has_seat=True, tool=tool)


@pytest.mark.parametrize("tool", tools(), ids=lambda one: one.words[0])
@pytest.mark.parametrize("heads", [4.0, 7.0])
def test_a_tool_is_seen_on_whoever_uses_it(tool: Tool, heads: float) -> None:
    without, figure = use(None, tool.pose, heads), use(tool, tool.pose, heads)
    across, up = figure.hand
    assert -0.7 <= across <= 0.7 and -0.1 <= up <= 1 and all(tool.things)
    drawn = [shape for shape in tool.shapes if shape[0] in ("area", "line", "ring", "dabs")]
    larger = figure.picture[3].numel() - without.picture[3].numel()
    assert not drawn or larger > 0 or not torch.equal(figure.picture, without.picture)
    assert (figure.meets is not None) == tool.meets


def test_the_tools_cover_what_people_do() -> None:
    known = {word for tool in tools() for word in tool.words}
    usual = (
        "fishing, knitting, sewing, sawing, ironing, mowing, sweeping, digging, hammering, baking, cooking, singing, "
        "juggling, rowing, cycling, skiing, surfing, hugging, kissing, proposing, reading, writing, typing, drinking"
    )
    assert {*usual.split(", ")} <= known
    assert len(known) == sum(len(tool.words) for tool in tools()), "no action has two tools"


def test_a_tool_has_the_colour_of_the_prompt() -> None:
    kite = tool_of("flying a kite")
    red, blue = (use(kite, kite.pose, color=color).picture for color in ("red", "blue"))
    assert not torch.equal(red, blue)


def tool_of(action: str) -> Tool:
    return next(tool for tool in tools() if action in tool.words)


def test_a_tool_reaches_from_the_hand_to_its_end() -> None:
    broom, leash = tool_of("sweeping"), tool_of("walking the dog")
    swept, led = use(broom, broom.pose), use(leash, leash.pose)
    assert swept.hand[1] < 0.05 and swept.hand[0] > 0.4, "what is swept is on the floor before the broom"
    assert led.hand[0] > 0.45


def test_what_is_behind_somebody_does_not_hide_them() -> None:
    bed = tool_of("sleeping in bed")
    order = [shape[0] for shape in bed.shapes]
    assert "body" in order and "arm" in order
    only = bed._replace(shapes=(("area", "magenta", "g-9,-9", "g9,-9", "g9,9", "g-9,9"), ("body",)))
    covered = use(only._replace(shapes=only.shapes[:1]), bed.pose)
    behind = use(only, bed.pose)
    assert middle_count(behind) > middle_count(covered) + 1000


def middle_count(figure: Figure) -> float:
    """Number of pixels that are red or blue as clothes are, and not magenta."""
    red, blue = figure.picture[0] > 0.5, figure.picture[2] > 0.5
    return float((red != blue).sum())


@pytest.mark.slow
@pytest.mark.parametrize("table", [tools(), wardrobe()], ids=["tools", "clothes"])
def test_every_word_chooses_its_own_row(table: Sequence[Tool | Clothes]) -> None:
    fetched("minilm")
    meanings = WordMeanings(SentenceEncoder.load())
    rows: tuple[Tool | Clothes, ...] = (*table,)
    for row in rows:
        assert [word for word in row.words if nearest([word], rows, meanings)[0] is not row] == []


@pytest.mark.slow
@pytest.mark.parametrize(
    ("said", "action"),
    [
        ("angling fish", "fishing"),
        ("knitting socks", "knitting"),
        ("sawing planks", "sawing"),
        ("pouring cup of coffee", "pouring tea"),
        ("hanging out washing", "hanging laundry"),
        ("carrying long ladder", "carrying a ladder"),
        ("pushing baby stroller", "pushing a pram"),
        ("strumming guitar", "playing the guitar"),
    ],
)
def test_an_action_in_other_words_has_its_tool(said: str, action: str) -> None:
    fetched("minilm")
    assert nearest([said], (*tools(), *poses()), SentenceEncoder.load())[0] is tool_of(action)
