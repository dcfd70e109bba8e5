"""Casting of people: who does something is drawn, and who only is somebody has a picture, if there is one."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import pytest
import torch
from torch import Tensor

from frida_painter.drawing.arrangement import Relation
from frida_painter.objectives.picture_library import Captioned
from frida_painter.words.account import Account
from frida_painter.words.casting import cast
from frida_painter.words.reading import Reading, SaidWord, Thing
from frida_painter.words.retrieval import FoundPicture, PictureIndex
from frida_painter.words.scene import account_for
from support.networks import QuickEncoders, WordBag


class People:
    """Pictures of people from head to foot, and of a goat."""

    name, credit, is_own = "people", "", False

    def list_captioned(self) -> Sequence[Captioned]:
        return [Captioned(said, (said,), 0.8) for said in ("baker", "man sleeping", "goat", "bread")]

    def pictures(self, file: str) -> list[Tensor]:
        picture = torch.rand(4, 90, 40, generator=torch.Generator().manual_seed(1))
        picture[3, :, :30] = 1
        picture[3, :, 30:] = 0
        return [picture]


class OwnPeople(People):
    is_own = True


def found(reading: Reading, folder: Path, library: People | None = None) -> list[FoundPicture | None]:
    index = PictureIndex([library or People()], WordBag(), folder)
    return cast(reading, set(), "as read", index, QuickEncoders(), in_place=False)


def acting(name: str, verb: str, *others: Thing, **further: str) -> Reading:
    """The reading of somebody who does something with others."""
    said = (SaidWord(0, name, name, "thing"), SaidWord(1, verb, verb, "action"))
    relations = tuple(Relation(0, further.get("by", verb), number) for number in range(1, len(others) + 1))
    return Reading((Thing(name, name, doing=verb, at=(0, 1)), *others), relations, said=said)


def test_somebody_has_a_picture_and_who_does_something_is_drawn(tmp_path: Path) -> None:
    (still,) = found(Reading((Thing("baker", "baker"),)), tmp_path)
    assert still is not None and still.library is not None and still.caption == "baker"
    (busy,) = found(acting("baker", "climbing"), tmp_path)
    assert busy is not None and busy.library is None and busy.figure is not None
    assert busy.caption == "baker climbing" and busy.exact and busy.figure.does == "climbing"
    assert "(drawn)" in busy.told


def test_a_picture_of_the_action_itself_is_taken(tmp_path: Path) -> None:
    (asleep,) = found(acting("man", "sleeping"), tmp_path)
    assert asleep is not None and asleep.caption == "man sleeping" and asleep.library is not None


def test_a_persons_own_picture_stays_whatever_it_does(tmp_path: Path) -> None:
    (busy,) = found(acting("baker", "climbing"), tmp_path, OwnPeople())
    assert busy is not None and busy.library is not None and busy.library.is_own


def test_who_has_no_picture_is_drawn_and_a_thing_is_not(tmp_path: Path) -> None:
    somebody, thing = found(Reading((Thing("monk", "monk"), Thing("loom", "loom"))), tmp_path)
    assert somebody is not None and somebody.figure is not None and somebody.figure.does == ""
    assert somebody.caption == "monk" and thing is None


def test_an_animal_that_does_something_is_no_figure(tmp_path: Path) -> None:
    (goat,) = found(acting("goat", "climbing"), tmp_path)
    assert goat is not None and goat.library is not None


def test_people_beside_who_acts_are_drawn_too_and_face_who_acts_on_them(tmp_path: Path) -> None:
    first, second = found(acting("monk", "shaving", Thing("baker", "baker")), tmp_path)
    assert first is not None and second is not None and first.figure is not None and second.figure is not None
    assert first.figure.hand[0] > 0 > second.figure.hand[0]


@pytest.mark.parametrize(("noun", "count"), [("baker", 3), ("couple", 2)])
def test_several_people_are_one_picture_and_the_account_says_how_many(noun: str, count: int, tmp_path: Path) -> None:
    thing = Thing(noun, noun, count=count, doing="dancing", at=(0,))
    (drawn,) = found(Reading((thing,)), tmp_path)
    if noun == "couple":  # the bag of words does not know that a couple is people; the dictionary does
        assert drawn is None or drawn.figure is not None
        return
    assert drawn is not None and drawn.several and drawn.shown == 1
    (alone,) = found(Reading((Thing(noun, noun, doing="dancing", at=(0,)),)), tmp_path)
    assert alone is not None and drawn.picture.shape[2] / drawn.picture.shape[1] > 1.5 * (
        alone.picture.shape[2] / alone.picture.shape[1]
    )


def test_the_old_are_said_to_be_old_and_a_trade_without_clothes_is_only_similar(tmp_path: Path) -> None:
    (old,) = found(Reading((Thing("old monk", "monk"),)), tmp_path)
    assert old is not None and old.caption == "old monk"
    (rusty,) = found(Reading((Thing("rusty monk", "monk"),)), tmp_path)
    assert rusty is not None and "rusty" not in rusty.caption
    (unknown,) = found(Reading((Thing("bailiff", "bailiff"),)), tmp_path)
    assert unknown is None or not unknown.exact


def test_who_does_something_on_a_bench_sits(tmp_path: Path) -> None:
    standing, _ = found(acting("baker", "feeding", Thing("goat", "goat")), tmp_path)
    sitting, _ = found(acting("baker", "feeding", Thing("bench", "bench"), by="on"), tmp_path)
    assert standing is not None and standing.figure is not None and standing.figure.seat == 0
    assert sitting is not None and sitting.figure is not None and sitting.figure.seat > 0.2


def test_the_tool_of_an_action_is_the_thing_that_the_prompt_names(tmp_path: Path) -> None:
    reading = acting("baker", "kneading dough", Thing("bread", "bread", color="black", at=(2,)))
    reading = replace(reading, said=(*reading.said, SaidWord(2, "bread", "bread", "thing")))
    baker, bread = found(reading, tmp_path)
    assert baker is not None and baker.caption.endswith("black bread") and bread is None
    account = Account(reading)
    account_for([baker, bread], reading, [], account)
    assert account.shows((2,))
    _, goat = found(acting("baker", "kneading dough", Thing("goat", "goat")), tmp_path)
    assert goat is not None, "which the tool does not show"


def test_who_is_hugged_hugs_too(tmp_path: Path) -> None:
    first, second = found(acting("monk", "hugging", Thing("baker", "baker")), tmp_path)
    assert first is not None and first.figure is not None and second is not None and second.figure is not None
    assert first.figure.meets is not None and second.figure.meets is not None
    (pair,) = found(Reading((Thing("monk", "monk", count=2, doing="hugging"),)), tmp_path)
    assert pair is not None
    shares = [one.picture.shape[2] / one.picture.shape[1] for one in (pair, first)]
    assert shares[0] < 1.9 * shares[1], "they touch"


def test_named_clothes_are_worn_and_a_persons_own_picture_stays(tmp_path: Path) -> None:
    reading = acting("baker", "climbing", Thing("apron", "apron", "red", at=(2,)), by="in")
    (plain,) = found(acting("baker", "climbing"), tmp_path)
    worn, apron = found(reading, tmp_path)
    assert plain is not None and worn is not None and worn.figure is not None and apron is None
    assert worn.caption == "baker climbing red apron" and not torch.equal(worn.picture, plain.picture)
    own, _ = found(reading, tmp_path, OwnPeople())
    assert own is not None and own.library is not None and own.library.is_own


def test_clothes_have_the_colour_and_not_the_skin(tmp_path: Path) -> None:
    plain, red = (found(Reading((Thing("monk", "monk", color=color),)), tmp_path)[0] for color in ("", "red"))
    assert plain is not None and red is not None
    changed = (plain.picture[:3] - red.picture[:3]).abs().amax(0) > 0.1
    assert 0.3 < float(changed[plain.picture[3] > 0.5].float().mean()) < 0.95


def test_the_head_of_somebody_is_no_other_thing(tmp_path: Path) -> None:
    _, head = found(acting("baker", "carrying", Thing("head", "head")), tmp_path)
    assert head is None
