"""Where things stand to each other."""

import itertools
from dataclasses import replace

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as some
from torch import Tensor

from frida_painter.drawing.arrangement import Known, Placed, Relation, ScenePart, arrange_parts, copies
from frida_painter.drawing.figures import Figure, draw_figure, poses, wardrobe


def thing(color: int, height: float, where: str = "ground", shape: tuple[int, int] = (40, 40)) -> ScenePart:
    picture = torch.zeros(4, *shape)
    picture[3], picture[color] = 1, 1
    return ScenePart(picture, Known("thing", height, where))


def table() -> ScenePart:
    picture = torch.zeros(4, 40, 60)
    picture[2, :], picture[3, :8], picture[3, :, :4], picture[3, :, -4:] = 1, 1, 1, 1
    return ScenePart(picture, Known("table", 0.8, "ground"))


def put(word: str, first: ScenePart, second: ScenePart) -> tuple[Placed, Placed]:
    placed = arrange_parts([first, second], [Relation(0, word, 1)])
    (one,) = [item for item in placed if item.picture is first.picture]
    (other,) = [item for item in placed if item.picture is second.picture]
    return one, other


def test_on_stands_on_top_in_front() -> None:
    cat, sofa = put("on", thing(0, 0.3), thing(1, 0.9, shape=(40, 80)))
    assert sofa.y == 0 and 0.8 * sofa.height <= cat.y <= sofa.height and cat.depth > sofa.depth
    assert abs(cat.x - sofa.x) < sofa.width / 2


def test_a_small_thing_on_a_large_one_is_seen_still() -> None:
    snail, elephant = put("on", thing(0, 0.03), thing(1, 3.2))
    assert snail.height >= 0.3 * elephant.height


def test_under_a_table_is_between_its_legs_and_under_the_moon_is_below_it() -> None:
    dog, over = put("under", thing(0, 0.6), table())
    assert dog.y == over.y == 0 and dog.height <= 0.5 * over.height and dog.depth > over.depth
    castle, moon = put("under", thing(0, 25), thing(1, 100, "air"))
    assert moon.y > 0.5 * castle.height and moon.height < castle.height


def figure(color: int, height: float = 1.7) -> ScenePart:
    """Somebody whose hand is in front, above the middle, and who sits on what carries them."""
    part = thing(color, height, "person", (40, 20))
    return replace(part, figure=Figure(part.picture, (0.5, 0.6), 0.4, 1.0))


@pytest.mark.parametrize("word", ["hugging", "with", "kissing"])
def test_two_who_meet_touch(word: str) -> None:
    first, second = figure(0), figure(1)
    assert first.figure is not None and second.figure is not None
    first = replace(first, figure=replace(first.figure, meets=0.3))
    second = replace(second, figure=replace(second.figure, meets=-0.2))
    one, other = put(word, first, second)
    assert one.x + 0.3 * one.width == pytest.approx(other.x - 0.2 * other.width) and one.y == other.y


@pytest.mark.parametrize("word", ["holding", "reading"])
def test_a_small_thing_is_in_the_hand_of_a_figure(word: str) -> None:
    book, reader = reversed(put(word, figure(0), thing(1, 0.2)))
    assert abs(book.x - (reader.x + 0.5 * reader.width)) < 1e-6
    assert book.y < reader.y + 0.6 * reader.height < book.y + book.height


def test_a_figure_touches_a_large_thing_and_a_duck_is_not_in_its_hand() -> None:
    oven, baker = reversed(put("opening", figure(0), thing(1, 1.8)))
    assert oven.y == baker.y and oven.depth < baker.depth and oven.x < baker.x + 0.5 * (baker.width + oven.width)
    duck, farmer = reversed(put("feeding", figure(0), thing(1, 0.35, "water")))
    assert duck.y == farmer.y and duck.x > farmer.x + farmer.width / 2
    baby, mother = reversed(put("carrying", figure(0), thing(1, 0.6, "person")))
    assert baby.y > mother.y + 0.2 * mother.height


def test_a_puppy_is_held_in_the_arms_and_one_that_is_fed_or_had_stands() -> None:
    for word, is_held in (("holding", True), ("feeding", False), ("with", False)):
        puppy, vet = reversed(put(word, figure(0), thing(1, 0.35, "animal")))
        assert (puppy.y > vet.y + 0.2 * vet.height) == is_held


def test_a_driver_is_at_the_window_of_a_car_and_a_scientist_is_not_in_a_microscope() -> None:
    driver, car = put("in", figure(0), thing(1, 1.5, shape=(40, 90)))
    lowest = driver.y + driver.hidden * driver.height
    assert 0.3 * car.height < lowest < 0.6 * car.height and driver.y + driver.height <= 1.05 * car.height
    scientist, microscope = put("into", figure(0), thing(1, 0.45))
    assert scientist.hidden == 0 and microscope.height < 0.5 * scientist.height


def test_a_lamp_does_not_make_people_tiny() -> None:
    man, lamp = put("beside", figure(0), thing(1, 20.0, shape=(80, 10)))
    assert man.height > 0.6 * lamp.height


def test_the_hips_of_a_rider_are_on_the_horse_and_who_is_in_a_house_stands_before_it() -> None:
    rider, horse = put("riding", figure(0), thing(1, 1.8, "animal"))
    hips = rider.y + 0.4 * rider.height
    assert abs(hips - (horse.y + horse.height)) < 0.05 * horse.height
    guest, house = put("in", figure(0), thing(1, 6.0))
    assert guest.depth > house.depth and guest.hidden == 0 and guest.y <= house.y
    sailor, boat = put("on", figure(0), thing(1, 2.0, "water", (20, 40)))
    assert sailor.hidden > 0 and sailor.y < boat.y + boat.height


def test_a_kite_that_is_flown_is_in_the_air_and_a_ball_that_is_kicked_is_not() -> None:
    boy, kite = put("flying", thing(0, 1.2), thing(1, 0.6, "air"))
    assert kite.y > 0.5 * boy.height
    boy, ball = put("kicking", thing(0, 1.2), thing(1, 0.2))
    assert ball.y == boy.y


def test_what_is_held_is_held_up_and_does_not_hide_who_holds_it() -> None:
    woman, umbrella = put("with", thing(0, 1.7, shape=(60, 24)), thing(1, 1.0, "held"))
    assert woman.y == 0 and 0.3 * woman.height < umbrella.y < 0.6 * woman.height
    assert umbrella.height <= 0.8 * woman.height and umbrella.depth < woman.depth
    (beach,) = arrange_parts([thing(1, 1.0, "held")], [])
    assert beach.y == 0, "by itself it stands"


def test_a_guitar_is_played_in_the_hands_and_a_piano_stands() -> None:
    man, guitar = put("playing", thing(0, 1.75, "person", shape=(60, 24)), thing(1, 1.0))
    assert guitar.depth > man.depth and man.y < guitar.y and guitar.y + guitar.height < man.y + man.height
    man, piano = put("playing", thing(0, 1.75, "person", shape=(60, 24)), thing(1, 1.7))
    assert piano.y == man.y and piano.x > man.x + 0.5 * man.width


@pytest.mark.parametrize("word", ["with", "in", "wearing"])
def test_a_hat_is_on_the_head_which_is_the_highest_part(word: str) -> None:
    parts = [thing(0, 0.6, shape=(40, 80)), thing(1, 0.2, "head", shape=(20, 40))]
    dog = parts[0].picture
    dog[3, :20], dog[3, :20, 60:72] = 0, 1  # a head at the right
    dog[3, 2:20, 4:10] = 1  # a tail that is almost as high
    placed = arrange_parts(parts, [Relation(0, word, 1)])
    below, hat = (next(one for one in placed if one.picture is part.picture) for part in parts)
    head = below.x + (66 / 80 - 0.5) * below.width
    assert abs(hat.x - head) < 0.03 * below.width and hat.depth > below.depth
    assert below.y + 0.8 * below.height < hat.y < below.y + below.height < hat.y + hat.height
    assert 0.15 * below.width < hat.width < 0.3 * below.width


def test_glasses_are_on_the_face_and_a_bow_tie_is_on_the_neck() -> None:
    up = {}
    for where in ("head", "face", "neck"):
        below, worn = put("wearing", thing(0, 0.6, shape=(60, 20)), thing(1, 0.1, where, shape=(10, 20)))
        assert abs(worn.x - below.x) < 0.02 * below.width and worn.depth > below.depth
        up[where] = (worn.y + 0.5 * worn.height - below.y) / below.height
    assert up["head"] > up["face"] + 0.1 > up["neck"] + 0.2 > 0.5


def test_an_umbrella_is_over_who_is_under_it_and_the_moon_is_high_that_is_howled_at() -> None:
    elephant, umbrella = put("under", thing(0, 3.2, shape=(40, 60)), thing(1, 1.0, "held", shape=(60, 60)))
    assert umbrella.width > elephant.width and umbrella.y > elephant.y + 0.7 * elephant.height
    wolf, moon = put("at", thing(0, 0.8), thing(1, 100.0, "air"))
    assert moon.y > wolf.y + 0.5 * wolf.height


def test_who_reads_under_a_tree_is_before_it() -> None:
    parts = [thing(0, 1.4), thing(1, 0.2), thing(2, 8.0)]
    placed = arrange_parts(parts, [Relation(0, "reading", 1), Relation(0, "under", 2)])
    girl, book, tree = (next(one for one in placed if one.picture is part.picture) for part in parts)
    assert girl.depth > tree.depth and girl.y < tree.y + 0.2 * tree.height and book.y < tree.y + 0.2 * tree.height


def test_a_tree_stands_behind_those_that_sit_on_something_under_it() -> None:
    parts = [thing(0, 1.7), thing(1, 0.8, "seat"), thing(2, 8)]
    placed = arrange_parts(parts, [Relation(0, "on", 1), Relation(0, "under", 2)])
    man, bench, tree = (next(one for one in placed if one.picture is part.picture) for part in parts)
    assert tree.y == bench.y == 0 < man.y and tree.depth < min(man.depth, bench.depth)
    assert tree.height >= 1.5 * (man.y + man.height) and abs(tree.x - man.x) < 1e-6


def test_who_shares_something_that_is_held_stands_on_the_floor() -> None:
    parts = [thing(0, 1.7, "person"), thing(1, 0.6, "animal"), thing(2, 0.1)]
    placed = arrange_parts(parts, [Relation(0, "sharing", 2), Relation(1, "sharing", 2)])
    man, dog, bread = (next(one for one in placed if one.picture is part.picture) for part in parts)
    assert man.y == dog.y == 0 < bread.y


def test_over_is_above_and_behind_is_hidden() -> None:
    bee, flower = put("above", thing(0, 0.015, "air"), thing(1, 0.4))
    assert bee.y >= flower.height
    rabbit, tree = put("behind", thing(0, 0.3), thing(1, 8))
    assert rabbit.depth < tree.depth and abs(rabbit.x - tree.x) > 0.2 * tree.width


@pytest.mark.parametrize(
    ("widths", "rim"),
    [
        ((40, 40, 40, 40), 1.0),
        ((8, 8, 40, 36), 0.5),
        ((4, 30, 4, 40), 0.25),
        ((30, 8, 40, 36), 1.0),
    ],
    ids=["bowl", "handle", "sail", "vase"],
)
def test_what_is_in_something_looks_out_over_its_rim(widths: tuple[int, ...], rim: float) -> None:
    picture = torch.zeros(4, 40, 40)
    for row, width in enumerate(widths):
        picture[:, 10 * row : 10 * row + 10, 20 - width // 2 : 20 + width // 2] = 1
    apples, bowl = put("in", thing(0, 0.08), ScenePart(picture, Known("bowl", 0.15, "ground")))
    assert apples.depth > bowl.depth and apples.height <= 0.8 * bowl.height
    assert apples.y + apples.hidden * apples.height == pytest.approx((rim - 0.1) * bowl.height)


def test_a_bowl_of_apples_holds_them() -> None:
    bowl, apples = put("of", thing(0, 0.15, shape=(20, 40)), thing(1, 0.08))
    assert apples.hidden > 0 and bowl.hidden == 0 and apples.x == bowl.x and bowl.y < apples.y < bowl.height


def test_what_is_with_something_by_a_table_stands_on_the_table_and_a_window_hangs_behind_it() -> None:
    desk, window = ScenePart(table().picture, Known("desk", 0.8, "top")), thing(1, 1.2, "wall")
    books, lamp = thing(0, 0.2), thing(0, 0.4, shape=(50, 20))
    placed = arrange_parts([desk, window, books, lamp], [Relation(0, "by", 1), Relation(1, "with", 2)])
    first, behind, *others = (
        next(one for one in placed if one.picture is part.picture) for part in (desk, window, books, lamp)
    )
    assert behind.depth < first.depth and behind.y > 0.4 * first.height
    assert all(one.y > 0.5 * first.height and one.depth > first.depth for one in others)


def test_what_is_tiny_is_less_than_the_least_of_others() -> None:
    mouse, elephant = thing(0, 0.06), thing(1, 3.2)
    plain, _ = put("beside", mouse, elephant)
    tiny, _ = put("beside", replace(mouse, size=0.5), elephant)
    assert tiny.height == pytest.approx(0.5 * plain.height)


def test_copies_that_lean_in_the_wind_lean_to_one_side() -> None:
    picture = torch.zeros(4, 40, 40)
    picture[:, :, :10] = 1
    mirrored, alike = (copies([picture] * 3, "plant", 0, leans=leans) for leans in (False, True))
    assert not torch.equal(mirrored, alike)


@pytest.mark.parametrize("word", ["on", "in"])
def test_two_on_one_thing_are_side_by_side(word: str) -> None:
    parts = [thing(0, 0.5), thing(1, 0.5), thing(2, 0.6, shape=(20, 40))]
    placed = arrange_parts(parts, [Relation(0, word, 2), Relation(1, word, 2)])
    (holder,) = [one for one in placed if one.picture is parts[2].picture]
    left, right = sorted((one for one in placed if one is not holder), key=lambda one: one.x)
    assert left.x + left.width / 2 <= right.x - right.width / 2 + 1e-6
    assert left.x >= holder.x - holder.width / 2 and right.x <= holder.x + holder.width / 2
    tops = {one.y + one.hidden * one.height for one in (left, right)}
    assert max(tops) - min(tops) < 1e-6 and (word == "on" or left.hidden > 0)


@pytest.mark.parametrize("word", ["beside", "next to", "and then some"])
def test_beside_does_not_hide(word: str) -> None:
    one, other = put(word, thing(0, 1.0), thing(1, 1.0))
    assert abs(one.x - other.x) >= (one.width + other.width) / 2 and one.y == other.y


def test_what_has_no_relation_stands_beside_and_what_has_no_picture_is_left_out() -> None:
    placed = arrange_parts([thing(0, 1), None, thing(1, 1), thing(2, 1)], [Relation(0, "on", 1)])
    edges = sorted((one.x - one.width / 2, one.x + one.width / 2) for one in placed)
    assert len(placed) == 3 and all(left >= right for (_, right), (left, _) in itertools.pairwise(edges))
    assert arrange_parts([None], []) == []


NUMBERS, WORDS = some.integers(0, 3), some.sampled_from(["on", "in", "under", "over", "behind", "with", "of", "x"])


@settings(max_examples=50)
@given(some.lists(some.tuples(NUMBERS, WORDS, NUMBERS), max_size=6))
def test_any_relations_place_every_thing_once(said: list[tuple[int, str, int]]) -> None:
    parts = [thing(0, 0.1), table(), thing(1, 20), thing(2, 1, "air")]
    placed = arrange_parts(parts, [Relation(*one) for one in said])
    assert sorted(id(one.picture) for one in placed) == sorted(id(part.picture) for part in parts)
    assert all(one.height > 0 for one in placed)


@pytest.mark.parametrize("count", [1, 2, 3, 5, 7, 12])
@pytest.mark.parametrize("where", ["ground", "air"])
def test_copies_are_all_there(count: int, where: str) -> None:
    drawing = thing(0, 1).picture
    together = copies([drawing] * count, where, seed=3)
    assert together.shape[0] == 4 and float(together.min()) >= 0 and float(together.max()) <= 1
    one = _area(copies([drawing], where, seed=3)) * (256 / 40) ** 2
    assert count * 0.35 * one <= _area(together) + (count == 1) * one <= (count + 1) * one
    assert torch.equal(together, copies([drawing] * count, where, seed=3)), "the same seed, the same place"


def _area(drawing: Tensor) -> float:
    return float(drawing[3].sum())


@pytest.mark.parametrize(
    ("word", "low", "high"), [("on lap", 0.15, 0.5), ("on shoulder", 0.6, 0.9), ("on back", 0.3, 0.8)]
)
def test_a_small_one_is_on_the_body_of_whoever_carries_it(word: str, low: float, high: float) -> None:
    person = Known("man", 1.75, "person")
    figure = draw_figure(
        next(one for one in poses() if "sitting" in one.words),
        wardrobe()[0],
        heads=7,
        is_old=False,
        kind=0,
        has_seat=True,
    )
    man, cat = ScenePart(figure.picture, person, figure), ScenePart(torch.ones(4, 20, 20), Known("cat", 0.3, "animal"))
    placed = {one.known.name: one for one in arrange_parts([cat, man], [Relation(0, word, 1)])}
    assert low < (placed["cat"].y - placed["man"].y) / placed["man"].height < high
    assert placed["cat"].height < 0.4 * placed["man"].height and placed["cat"].depth > placed["man"].depth


def test_what_is_on_a_seat_sits_in_it_and_small_things_are_in_the_hands() -> None:
    cat, sofa = put("on", thing(0, 0.3), thing(1, 0.8, "seat", shape=(40, 80)))
    assert sofa.y + 0.3 * sofa.height < cat.y < sofa.y + 0.6 * sofa.height and cat.depth > sofa.depth
    woman, book = put("reading", thing(0, 1.7, "person", shape=(60, 24)), thing(1, 0.22))
    assert woman.y + 0.2 * woman.height < book.y < woman.y + 0.6 * woman.height and book.depth > woman.depth
    man, dog = put("with", thing(0, 1.7, "person", shape=(60, 24)), thing(1, 0.6, "animal"))
    assert dog.y == man.y


@pytest.mark.parametrize(("word", "least", "most"), [("taller than", 1.3, 9), ("smaller than", 0, 0.77)])
def test_what_is_taller_than_another_thing_stands_beside_it_in_that_order(word: str, least: float, most: float) -> None:
    one, other = put(word, thing(0, 1.0), thing(1, 1.2))
    assert one.y == other.y and least <= one.height / other.height <= most
    assert abs(one.x - other.x) >= 0.5 * (one.width + other.width)


def test_what_hangs_is_below_what_it_hangs_from() -> None:
    sock, line = put("hanging on", thing(0, 0.3), table())
    assert line.y + 0.7 * line.height < sock.y + sock.height < line.y + line.height
    assert sock.y < line.y + 0.7 * line.height and abs(sock.x - line.x) < 1e-6


def test_what_is_in_something_clear_is_seen_whole_and_flowers_stand_out_of_it() -> None:
    bird, cage = put("in", thing(0, 0.15), thing(1, 0.5, "clear"))
    assert bird.hidden == 0 and cage.y < bird.y and bird.y + bird.height < cage.y + cage.height
    rose, jar = put("in", thing(0, 0.4, "plant", (60, 20)), thing(1, 0.2, "clear"))
    assert rose.hidden > 0 and rose.y + rose.height > jar.y + 1.3 * jar.height


def test_an_animal_holds_a_thing_in_its_mouth_and_what_is_in_a_pot_on_a_sill_is_in_it() -> None:
    dog = thing(0, 0.6, "animal", (40, 80))
    dog.picture[3, :20], dog.picture[3, :12, 60:] = 0, 1  # a head at the right
    stick, below = put("in the mouth of", thing(1, 0.4, shape=(10, 40)), dog)
    assert abs(stick.x - below.x - 0.5 * below.width) < 0.05 * below.width and stick.depth > below.depth
    assert below.y + 0.7 * below.height < stick.y + stick.height / 2 < below.y + 1.01 * below.height
    parts = [thing(0, 0.3), thing(1, 0.5), thing(2, 1.6, "seat")]
    placed = arrange_parts(parts, [Relation(0, "in", 1), Relation(0, "on", 2)])
    cactus, pot, sill = (next(one for one in placed if one.picture is part.picture) for part in parts)
    assert sill.y < pot.y < cactus.y < pot.y + pot.height and cactus.x == pot.x


def test_a_bunch_is_spread_from_one_foot() -> None:
    stem = torch.zeros(4, 60, 20)
    stem[3, :, 8:12] = 1
    seen = copies([stem] * 3, "bunch", 0)[3] > 0.5
    top, foot = (rows.any(0).nonzero().flatten() for rows in (seen[:20], seen[-6:]))
    assert int(top[-1] - top[0]) > 2 * int(foot[-1] - foot[0])


def test_a_tiny_elephant_is_smaller_than_a_giant_strawberry() -> None:
    elephant, strawberry = thing(0, 3.0), thing(1, 0.03)
    first, second = put("beside", elephant, strawberry)
    assert first.height > second.height
    tiny, giant = put("beside", replace(elephant, size=0.5), replace(strawberry, size=2.5))
    assert tiny.height < 0.5 * giant.height
