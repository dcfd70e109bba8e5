"""Which picture is taken for a thing. Names mean what their words mean together; pictures look as their colour does."""

from collections.abc import Sequence
from pathlib import Path

import pytest
import torch
from torch import Tensor

from frida_painter.errors import ImageError
from frida_painter.objectives.picture_library import Captioned
from frida_painter.words.reading import Thing
from frida_painter.words.retrieval import OWN, PictureIndex
from support.networks import WordBag


class Library:
    """Cut-outs of one colour each."""

    credit = ""

    def __init__(
        self, name: str, known: dict[str, tuple[tuple[str, ...], float, tuple[float, ...]]], own: bool = False
    ):
        self.name, self.is_own, self.known = name, own, known

    def list_captioned(self) -> Sequence[Captioned]:
        return [Captioned(file, captions, realism) for file, (captions, realism, _) in self.known.items()]

    def pictures(self, file: str) -> list[Tensor]:
        color = self.known[file][2]
        if not color:
            raise ImageError(f"{file} is damaged.")
        drawing = torch.ones(4, 40, 40)
        drawing[:3] = torch.tensor(color)[:, None, None]
        drawing[3, :8] = 0
        return [drawing]


RED, BLUE, GREEN = (0.9, 0.1, 0.1), (0.1, 0.1, 0.9), (0.1, 0.7, 0.1)
ICONS = Library(
    "icons", {"1": (("fox",), 0.0, BLUE), "2": (("sewing needle",), 0.0, RED), "3": (("wind face",), 0.0, RED)}
)
PHOTOS = Library("photos", {"4": (("a fox (2)", "animals"), 0.8, RED), "5": (("a bus stop", "bus"), 0.8, GREEN)})


def test_a_photograph_goes_before_a_sign(tmp_path: Path) -> None:
    index = PictureIndex([ICONS, PHOTOS], WordBag(), tmp_path)
    found = index.find(Thing("fox", "fox"), "a fox")
    assert found is not None and found.library.name == "photos" and found.caption == "fox" and found.exact


def test_a_persons_own_picture_goes_before_others(tmp_path: Path) -> None:
    own = Library("your pictures", {"x": (("fox",), 1.0, GREEN)}, own=True)
    found = PictureIndex([ICONS, PHOTOS, own], WordBag(), tmp_path).find(Thing("fox", "fox"), "a fox")
    assert found is not None and found.library.is_own


def test_a_keyword_counts_as_far_as_the_title_agrees(tmp_path: Path) -> None:
    index = PictureIndex([PHOTOS], WordBag(), tmp_path)
    assert index.nearest(Thing("bus", "bus")) > index.nearest(Thing("animals", "animals"))


def test_what_is_damaged_is_passed_over(tmp_path: Path) -> None:
    bad = Library("bad", {"y": (("fox",), 1.0, ())})
    found = PictureIndex([bad, ICONS], WordBag(), tmp_path).find(Thing("fox", "fox"), "a fox")
    assert found is not None and found.library.name == "icons"
    assert PictureIndex([bad], WordBag(), tmp_path).find(Thing("fox", "fox"), "a fox") is None


def test_captions_are_read_once(tmp_path: Path, monkeypatch) -> None:
    PictureIndex([ICONS], WordBag(), tmp_path)
    embedded: list[str] = []
    monkeypatch.setattr(WordBag, "embed", lambda self, said: embedded.extend(said))
    PictureIndex([ICONS], WordBag(), tmp_path)
    assert embedded == []


def test_of_words_that_make_one_name_the_last_says_what_it_is(tmp_path: Path) -> None:
    drawings = {"1": (("mountain goat",), 0.8, RED), "2": (("goat with a mountain",), 0.8, RED)}
    library = Library("drawings", drawings | {"3": (("high mountain",), 0.4, BLUE)})
    index = PictureIndex([library], WordBag(), tmp_path)
    found = index.find(Thing("mountain", "mountain"), "a mountain")
    assert found is not None and found.caption == "high mountain"


def test_what_something_else_is_on_is_not_shown_by_its_picture(tmp_path: Path) -> None:
    index = PictureIndex([Library("drawings", {"1": (("owl on branch",), 0.8, RED)})], WordBag(), tmp_path)
    assert index.find(Thing("branch", "branch"), "a branch") is None
    assert index.find(Thing("branch", "branch"), "a branch", cut_out=True) is None


def test_own_pictures_go_before_all_others_unless_they_are_damaged(tmp_path: Path) -> None:
    photos = Library("photos", {"1": (("door",), 0.8, RED)})
    for files, taken in (({"2": (("old door to tom",), 1.0, BLUE)}, "own"), ({"3": (("door",), 1.0, ())}, "photos")):
        index = PictureIndex([Library("own", files, own=True), photos], WordBag(), tmp_path / taken)
        for cut_out in (False, True):
            found = index.find(Thing("door", "door"), "a door", cut_out=cut_out)
            assert found is not None and found.library.name == taken and found.exact
        assert index.faults == ([] if taken == "own" else ["3 is damaged."] * 2)
        assert index.nearest(Thing("door", "door")) >= OWN > index.nearest(Thing("gate", "gate"))


def test_who_does_something_has_hands_and_feet(tmp_path: Path) -> None:
    class Figures(Library):
        def pictures(self, file: str) -> list[Tensor]:
            (head,) = super().pictures(file)
            return [head if file == "head" else head.repeat(1, 2, 1)]

    index = PictureIndex(
        [Figures("people", {"head": (("boy",), 0.9, RED), "figure": (("boy",), 0.7, BLUE)})], WordBag(), tmp_path
    )
    for acts in (False, True):
        found = index.find(Thing("boy", "boy"), "a boy", acts=acts)
        assert found is not None and (found.picture.shape[1] > found.picture.shape[2]) is acts


def test_a_picture_that_does_what_was_said_or_has_the_colour_in_its_name_goes_before(tmp_path: Path) -> None:
    known = {"1": (("woman",), 0.8, RED), "2": (("dancing woman",), 0.5, BLUE), "3": (("red panda",), 0.2, RED),
             "4": (("panda",), 0.8, BLUE)}  # fmt: skip
    index = PictureIndex([Library("pictures", known)], WordBag(), tmp_path)
    cases = {"dancing woman": Thing("woman", "woman", doing="dancing"), "woman": Thing("woman", "woman"),
             "red panda": Thing("panda", "panda", "red"), "panda": Thing("panda", "panda")}  # fmt: skip
    for title, thing in cases.items():
        found = index.find(thing, title)
        assert found is not None and found.caption == title and found.exact


def test_names_are_found_by_their_letters_whatever_their_size(tmp_path: Path) -> None:
    known = {"1": (("tower",), 0.8, RED), "2": (("Eiffel Tower",), 0.8, BLUE)}
    index = PictureIndex([Library("pictures", known)], WordBag(), tmp_path)
    found = index.find(Thing("Eiffel Tower", "Tower"), "the Eiffel Tower")
    assert found is not None and found.caption == "eiffel tower" and found.exact


def test_another_kind_is_no_picture_of_the_thing(tmp_path: Path) -> None:
    library = Library("drawings", {"1": (("paper machine",), 0.8, RED)})
    index = PictureIndex([library], WordBag(), tmp_path)
    for name, exact in (("paper machine", True), ("washing machine", False), ("machine", True)):
        found = index.find(Thing(name, "machine"), f"a {name}")
        assert (found is not None and found.exact) is exact, name


def test_nothing_stands_for_a_thing_from_afar_and_only_a_person_for_a_person(tmp_path: Path) -> None:
    library = Library("drawings", {"1": (("tooth",), 0.8, RED), "2": (("old doctor",), 0.8, RED)})

    class Trade(WordBag):
        """A dentist is near a tooth, and less near a doctor."""

        def _sum(self, sentence: str) -> Tensor:
            more = {"dentist": ("tooth", "tooth", "doctor", "doctor"), "surgeon": ("doctor",)}
            return super()._sum(" ".join((sentence, *more.get(sentence, ()))))

    index = PictureIndex([library], Trade(), tmp_path)
    assert index._similarity(Thing("dentist", "dentist"))[0] > 0.6
    tooth = index.find(Thing("dentist", "dentist"), "a dentist")
    assert tooth is None or tooth.caption == "old doctor"
    assert index.find(Thing("zeppelin", "zeppelin"), "a zeppelin") is None


def test_a_hyphen_makes_a_name_of_its_own(tmp_path: Path) -> None:
    library = Library("drawings", {"1": (("jack-o'-lantern",), 0.8, RED), "2": (("paper lantern",), 0.4, BLUE)})
    found = PictureIndex([library], WordBag(), tmp_path).find(Thing("lantern", "lantern"), "a lantern")
    assert found is not None and found.caption == "paper lantern"


def test_a_photograph_goes_before_flat_areas_of_the_same_kind_of_file(tmp_path: Path) -> None:
    class Textured(Library):
        def pictures(self, file: str) -> list[Tensor]:
            (drawing,) = super().pictures(file)
            drawing[:3] += 0.05 * torch.rand(drawing[:3].shape, generator=torch.Generator().manual_seed(1))
            return [drawing]

    flat, textured = Library("flat", {"1": (("fox",), 0.8, GREEN)}), Textured("textured", {"1": (("fox",), 0.8, GREEN)})
    found = PictureIndex([flat, textured], WordBag(), tmp_path).find(Thing("fox", "fox"), "a fox")
    assert found is not None and found.library.name == "textured"


def test_a_picture_of_several_shows_a_plural_or_a_pair_once(tmp_path: Path) -> None:
    index = PictureIndex([Library("drawings", {"1": (("foxes",), 0.4, RED)})], WordBag(), tmp_path)
    for count, several in ((None, True), (2, True), (3, False), (1, False)):
        found = index.find(Thing("foxes", "foxes", count=count, plural="foxes"), "foxes")
        assert found is not None and found.several is several
    single = PictureIndex([PHOTOS], WordBag(), tmp_path).find(Thing("fox", "fox", count=2, plural="foxes"), "foxes")
    assert single is not None and not single.several


def test_no_other_thing_of_a_similar_name_is_taken(tmp_path: Path) -> None:
    index = PictureIndex([Library("drawings", {"1": (("fox glove",), 0.4, RED)})], WordBag(), tmp_path)
    assert index.find(Thing("fox", "fox"), "a fox") is None


class Taught(WordBag):
    """To which some words are rather like others."""

    def __init__(self, **like: str) -> None:
        self._like = like

    def _sum(self, sentence: str) -> Tensor:
        return super()._sum(
            " ".join((sentence, *(self._like.get(word, "") for word in sentence.replace(",", "").split())))
        )


def test_a_kind_shows_what_it_is_of_and_nothing_else_does_only_because_it_is_like_it(tmp_path: Path) -> None:
    names = ("duck", "sailboat", "lady beetle", "trout")
    library = Library("photos", {name: ((name,), 0.8, RED) for name in names})
    sentences = Taught(duck="goose", salmon="trout", oak="tree", ladybird="beetle")
    index = PictureIndex([library, Library("trees", {"1": (("tree",), 0.8, GREEN)})], sentences, tmp_path)
    for name, caption, exact in (
        ("goose", None, False),
        ("salmon", None, False),
        ("oak", "tree", False),
        ("duck", "duck", True),
        ("lady beetle", "lady beetle", True),
        ("ladybird", "lady beetle", True),
    ):
        found = index.find(Thing(name, name.split()[-1]), f"a {name}")
        assert (found and (found.caption, found.exact)) == (caption and (caption, exact)), name


def test_the_prompt_says_which_sense_of_a_noun_is_meant(tmp_path: Path) -> None:
    boards = Library("a", {"1": (("chessboard",), 0.8, RED), "2": (("bread board",), 0.4, BLUE)})
    sentences = Taught(gameboard="chess", chessboard="board", bread="sheet board")
    index = PictureIndex([boards], sentences, tmp_path)
    board = Thing("board", "board")
    for prompt, caption in (("bread on a board", "bread board"), ("chess on a board", "chessboard")):
        found = index.find(board, prompt)
        assert found is not None and found.caption == caption


def test_a_plain_thing_goes_before_that_of_an_occasion(tmp_path: Path) -> None:
    known = {"1": (("pumpkin", "halloween"), 0.4, RED), "2": (("pumpkin", "vegetables"), 0.3, BLUE)}
    index = PictureIndex([Library("a", known)], WordBag(), tmp_path)
    for prompt, color in (("a pumpkin", BLUE), ("a pumpkin at Halloween", RED)):
        found = index.find(Thing("pumpkin", "pumpkin"), prompt)
        assert found is not None and tuple(found.picture[:3, -1, -1].tolist()) == pytest.approx(color)


def test_an_icon_needs_the_same_name(tmp_path: Path) -> None:
    index = PictureIndex([Library("icons", {"1": (("drawbridge",), 0.0, BLUE)})], Taught(drawbridge="bridge"), tmp_path)
    assert index.find(Thing("bridge", "bridge"), "a bridge") is None
    assert index.find(Thing("drawbridge", "drawbridge"), "a drawbridge") is not None


def test_a_keyword_and_a_plural_say_what_a_picture_shows(tmp_path: Path) -> None:
    library = Library("models", {"1": (("stroller", "pram"), 0.6, RED), "2": (("lily pads",), 0.6, GREEN)})
    index = PictureIndex([library], Bag(), tmp_path)
    for name in ("pram", "lily pad"):
        found = index.find(Thing(name, name.split()[-1]), f"a {name}")
        assert found is not None and found.exact, name


class Bag(WordBag):
    """A pad is nearly "pads", and a pram nearly a stroller."""

    def embed(self, sentences: Sequence[str]) -> Tensor:
        like = {"pad": "lily pads", "lily pad": "lily pads stem", "pram": "stroller pram"}
        return super().embed([like.get(sentence, sentence) for sentence in sentences])


def test_a_kind_is_no_other_kind(tmp_path: Path) -> None:
    players = Library("a", {"1": (("football player",), 0.8, RED), "2": (("player",), 0.4, BLUE)})
    index = PictureIndex([players], WordBag(), tmp_path)
    chess, player = Thing("chess player", "player"), Thing("player", "player")
    assert [found.caption for thing in (chess, player) if (found := index.find(thing, "players"))] == [
        "player",
        "player",
    ]
    only = PictureIndex([Library("b", {"1": (("football player",), 0.8, RED)})], WordBag(), tmp_path)
    assert only.find(chess, "players") is None and only.find(Thing("football player", "player"), "players") is not None


def test_a_number_of_things_is_not_shown_by_a_picture_of_several(tmp_path: Path) -> None:
    books = Library("a", {"1": (("books",), 0.8, RED), "2": (("book",), 0.4, BLUE)})
    index = PictureIndex([books], WordBag(), tmp_path)
    for thing, caption in (
        (Thing("book", "book"), "book"),
        (Thing("book", "book", count=5, plural="books"), "book"),
        (Thing("book", "book", count=None, plural="books"), "books"),
    ):
        found = index.find(thing, "books")
        assert found is not None and found.caption == caption, thing


def test_pictures_with_a_ground_do_not_hide_the_cut_outs(tmp_path: Path) -> None:
    class Grounds(Library):
        def pictures(self, file: str) -> list[Tensor]:
            (picture,) = super().pictures(file)
            picture[3] = 1
            return [picture]

    many = Grounds("a", {str(number): (("goldfish",), 0.8, RED) for number in range(12)})
    fish = Library("b", {"x": (("orange goldfish",), 0.4, BLUE)})
    found = PictureIndex([many, fish], WordBag(), tmp_path).find(
        Thing("goldfish", "goldfish"), "goldfish", cut_out=True
    )
    assert found is not None and found.caption == "orange goldfish"


def test_a_picture_has_the_asked_colour_and_one_piece(tmp_path: Path) -> None:
    class Halves(Library):
        def pictures(self, file: str) -> list[Tensor]:
            (whole,) = super().pictures(file)
            whole[3, 22:26] *= file != "halves"
            return [whole]

    sea = (0.1, 0.3, 0.8)
    index = PictureIndex(
        [Halves("fruit", {"halves": (("lemon",), 0.8, RED), "whole": (("lemon",), 0.6, sea)})], WordBag(), tmp_path
    )
    for color, count, taken in (("", 1, sea), ("", None, RED), ("red", None, RED), ("blue", None, sea)):
        found = index.find(Thing("lemon", "lemon", color, count), "lemon")
        assert found is not None and torch.allclose(found.picture[:3, -1, -1], torch.tensor(taken)), (color, count)
