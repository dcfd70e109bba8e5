"""Which picture is taken for a thing. Names mean what their words mean together; pictures look as their colour does."""

from collections.abc import Sequence
from pathlib import Path

import torch
from torch import Tensor

from frida_painter.errors import ImageError
from frida_painter.words.libraries import Captioned
from frida_painter.words.reading import Thing
from frida_painter.words.retrieval import PictureIndex
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


def nowhere(picture: Tensor) -> float:
    return 0.5


def test_what_looks_more_like_the_thing_is_taken(tmp_path: Path) -> None:
    index = PictureIndex([ICONS, PHOTOS], WordBag(), tmp_path)
    found = index.find(Thing("fox", "fox"), "a fox", nowhere)
    assert found is not None and found.library.name == "photos" and found.caption == "fox" and found.exact
    far = PictureIndex([ICONS, Library("photos", {"4": (("fox",), 0.3, RED)})], WordBag(), tmp_path)
    for color, name in ((BLUE, "icons"), (RED, "photos")):

        def distance(picture: Tensor, wanted: tuple[float, ...] = color) -> float:
            return 0.3 * float((picture.mean((1, 2)) - torch.tensor(wanted)).norm())

        seen = far.find(Thing("fox", "fox"), "a fox", distance)
        assert seen is not None and seen.library.name == name, "the networks decide between two that are called alike"


def test_a_persons_own_picture_goes_before_others(tmp_path: Path) -> None:
    own = Library("your pictures", {"x": (("fox",), 1.0, GREEN)}, own=True)
    found = PictureIndex([ICONS, PHOTOS, own], WordBag(), tmp_path).find(Thing("fox", "fox"), "a fox", nowhere)
    assert found is not None and found.library.is_own


def test_a_synonym_counts_only_where_the_caption_agrees_with_the_words(tmp_path: Path) -> None:
    index = PictureIndex([ICONS], WordBag(), tmp_path)
    assert index.find(Thing("dragonfly", "dragonfly"), "a dragonfly", nowhere) is None, "no darning needle"
    assert index.find(Thing("wind turbine", "turbine"), "a wind turbine", nowhere, least=0.55) is None, "no face"


def test_a_keyword_counts_as_far_as_the_title_agrees(tmp_path: Path) -> None:
    index = PictureIndex([PHOTOS], WordBag(), tmp_path)
    assert index.nearest(Thing("bus", "bus")) > index.nearest(Thing("animals", "animals"))


def test_what_is_damaged_is_passed_over(tmp_path: Path) -> None:
    bad = Library("bad", {"y": (("fox",), 1.0, ())})
    found = PictureIndex([bad, ICONS], WordBag(), tmp_path).find(Thing("fox", "fox"), "a fox", nowhere)
    assert found is not None and found.library.name == "icons"
    assert PictureIndex([bad], WordBag(), tmp_path).find(Thing("fox", "fox"), "a fox", nowhere) is None


def test_captions_are_read_once(tmp_path: Path, monkeypatch) -> None:
    PictureIndex([ICONS], WordBag(), tmp_path)
    embedded: list[str] = []
    monkeypatch.setattr(WordBag, "embed", lambda self, said: embedded.extend(said))
    PictureIndex([ICONS], WordBag(), tmp_path)
    assert embedded == []


def test_of_words_that_make_one_name_the_last_says_what_it_is(tmp_path: Path) -> None:
    drawings = {"1": (("mountain goat",), 0.8, RED), "2": (("goat with a mountain",), 0.8, RED)}
    library = Library("drawings", drawings | {"3": (("high mountain",), 0.0, BLUE)})
    index = PictureIndex([library], WordBag(), tmp_path)
    found = index.find(Thing("mountain", "mountain"), "a mountain", nowhere)
    assert found is not None and found.caption == "high mountain"


def test_what_something_else_is_on_is_not_shown_by_its_picture(tmp_path: Path) -> None:
    index = PictureIndex([Library("drawings", {"1": (("owl on branch",), 0.8, RED)})], WordBag(), tmp_path)
    assert index.find(Thing("owl", "owl"), "an owl", nowhere, least=0.5) is not None
    assert index.find(Thing("branch", "branch"), "a branch", nowhere) is None
    assert index.find(Thing("branch", "branch"), "a branch", nowhere, cut_out=True) is None


def test_own_pictures_go_before_all_others_unless_they_are_damaged(tmp_path: Path) -> None:
    photos = Library("photos", {"1": (("door",), 0.8, RED)})
    for files, taken in (({"2": (("old door to tom",), 1.0, BLUE)}, "own"), ({"3": (("door",), 1.0, ())}, "photos")):
        index = PictureIndex([Library("own", files, own=True), photos], WordBag(), tmp_path / taken)
        for cut_out in (False, True):
            found = index.find(Thing("door", "door"), "a door", nowhere, cut_out=cut_out)
            assert found is not None and found.library.name == taken and found.exact
        assert index.faults == ([] if taken == "own" else ["3 is damaged."] * 2)
        assert index.has_own(Thing("door", "door")) and not index.has_own(Thing("gate", "gate"))


def test_who_does_something_has_hands_and_feet(tmp_path: Path) -> None:
    class Figures(Library):
        def pictures(self, file: str) -> list[Tensor]:
            (head,) = super().pictures(file)
            return [head if file == "head" else head.repeat(1, 2, 1)]

    index = PictureIndex(
        [Figures("people", {"head": (("boy",), 0.9, RED), "figure": (("boy",), 0.7, BLUE)})], WordBag(), tmp_path
    )
    for acts in (False, True):
        found = index.find(Thing("boy", "boy"), "a boy", nowhere, acts=acts)
        assert found is not None and (found.picture.shape[1] > found.picture.shape[2]) is acts


def test_a_picture_that_does_what_was_said_or_has_the_colour_in_its_name_goes_before(tmp_path: Path) -> None:
    known = {"1": (("woman",), 0.8, RED), "2": (("dancing woman",), 0.5, BLUE), "3": (("red panda",), 0.2, RED),
             "4": (("panda",), 0.8, BLUE)}  # fmt: skip
    index = PictureIndex([Library("pictures", known)], WordBag(), tmp_path)
    cases = {"dancing woman": Thing("woman", "woman", doing="dancing"), "woman": Thing("woman", "woman"),
             "red panda": Thing("panda", "panda", "red"), "panda": Thing("panda", "panda")}  # fmt: skip
    for title, thing in cases.items():
        found = index.find(thing, title, nowhere)
        assert found is not None and found.caption == title and found.exact


def test_names_are_found_by_their_letters_whatever_their_size(tmp_path: Path) -> None:
    known = {"1": (("tower",), 0.8, RED), "2": (("Eiffel Tower",), 0.8, BLUE)}
    index = PictureIndex([Library("pictures", known)], WordBag(), tmp_path)
    found = index.find(Thing("Eiffel Tower", "Tower"), "the Eiffel Tower", nowhere)
    assert found is not None and found.caption == "eiffel tower" and found.exact


def test_a_colour_in_brackets_is_part_of_a_caption(tmp_path: Path) -> None:
    ducks = {"1": (("Duck (Yellow)",), 0.8, RED), "2": (("Duck (walking)",), 0.8, BLUE)}
    index = PictureIndex([Library("stamps", ducks)], WordBag(), tmp_path)
    found = index.find(Thing("duck", "duck", "yellow"), "a yellow duck", nowhere)
    assert found is not None and found.caption == "yellow duck"


def test_another_kind_is_no_picture_of_the_thing(tmp_path: Path) -> None:
    library = Library("drawings", {"1": (("sewing machine",), 0.8, RED)})
    index = PictureIndex([library], WordBag(), tmp_path)
    for name, exact in (("sewing machine", True), ("washing machine", False), ("machine", True)):
        found = index.find(Thing(name, "machine"), f"a {name}", nowhere)
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
    tooth = index.find(Thing("dentist", "dentist"), "a dentist", nowhere)
    assert tooth is None or tooth.caption == "old doctor"
    assert index.find(Thing("zeppelin", "zeppelin"), "a zeppelin", nowhere) is None


def test_of_two_things_that_one_picture_shows_the_first_is_not_only_a_kind_of_the_second(tmp_path: Path) -> None:
    library = Library("drawings", {"1": (("spider web",), 0.8, RED), "2": (("spider in web",), 0.4, BLUE)})
    index = PictureIndex([library], WordBag(), tmp_path)
    whole = Thing("spider in web", "spider in web")
    found = index.find(whole, "a spider in a web", nowhere, shows=("spider", "web"))
    assert found is not None and found.caption == "spider in web"
    found = index.find(whole, "a web", nowhere, shows=("web", "spider"))
    assert found is not None


def test_a_hyphen_makes_a_name_of_its_own(tmp_path: Path) -> None:
    library = Library("drawings", {"1": (("jack-o'-lantern",), 0.8, RED), "2": (("paper lantern",), 0.0, BLUE)})
    found = PictureIndex([library], WordBag(), tmp_path).find(Thing("lantern", "lantern"), "a lantern", nowhere)
    assert found is not None and found.caption == "paper lantern"


def test_networks_count_less_where_they_know_no_class_of_that_kind(tmp_path: Path) -> None:
    def redness(picture: Tensor) -> float:
        return 1 - float(picture[0].mean() - picture[2].mean())

    for noun, name in (("fox", "drawn"), ("thimblerig", "photos")):
        drawn, photos = (
            Library(where, {"1": ((noun,), realism, color)})
            for where, realism, color in (("drawn", 0.2, RED), ("photos", 0.8, BLUE))
        )
        index = PictureIndex([drawn, photos], WordBag(), tmp_path)
        found = index.find(Thing(noun, noun), f"a {noun}", redness)
        assert found is not None and found.library.name == name


def test_a_photograph_goes_before_flat_areas_of_the_same_kind_of_file(tmp_path: Path) -> None:
    class Textured(Library):
        def pictures(self, file: str) -> list[Tensor]:
            (drawing,) = super().pictures(file)
            drawing[:3] += 0.05 * torch.rand(drawing[:3].shape, generator=torch.Generator().manual_seed(1))
            return [drawing]

    flat, textured = Library("flat", {"1": (("fox",), 0.8, GREEN)}), Textured("textured", {"1": (("fox",), 0.8, GREEN)})
    found = PictureIndex([flat, textured], WordBag(), tmp_path).find(Thing("fox", "fox"), "a fox", nowhere)
    assert found is not None and found.library.name == "textured"


def test_a_picture_of_several_shows_a_plural_or_a_pair_once(tmp_path: Path) -> None:
    index = PictureIndex([Library("drawings", {"1": (("foxes",), 0.4, RED)})], WordBag(), tmp_path)
    for count, several in ((None, True), (2, True), (3, False), (1, False)):
        found = index.find(Thing("foxes", "foxes", count=count, plural="foxes"), "foxes", nowhere)
        assert found is not None and found.several is several
    single = PictureIndex([PHOTOS], WordBag(), tmp_path).find(
        Thing("fox", "fox", count=2, plural="foxes"), "foxes", nowhere
    )
    assert single is not None and not single.several


def test_among_others_no_other_thing_of_a_similar_name_is_taken(tmp_path: Path) -> None:
    index = PictureIndex([Library("drawings", {"1": (("fox glove",), 0.4, RED)})], WordBag(), tmp_path)
    assert index.find(Thing("fox", "fox"), "a fox", nowhere) is not None, "alone, it is better than nothing"
    assert index.find(Thing("fox", "fox"), "a fox on a log", nowhere, cut_out=True) is None


def test_a_picture_of_one_thing_does_not_stand_for_two(tmp_path: Path) -> None:
    library = Library("drawings", {"1": (("bus",), 0.4, RED), "2": (("fox with bus",), 0.4, BLUE)})
    whole = Thing("fox with bus", "fox with bus")
    both = PictureIndex([library], WordBag(), tmp_path).find(
        whole, "a fox with a bus", nowhere, least=0.5, shows=("fox", "bus")
    )
    assert both is not None and both.caption == "fox with bus"
    alone = Library("drawings", {"1": (("bus",), 0.4, RED)})
    assert (
        PictureIndex([alone], WordBag(), tmp_path).find(whole, "a fox with a bus", nowhere, least=0.3, shows=("bus",))
        is None
    )


class Poultry(WordBag):
    """To which ducks are rather like geese."""

    def _sum(self, sentence: str) -> Tensor:
        meaning = super()._sum(sentence)
        return meaning + super()._sum("goose") if "duck" in sentence else meaning


def test_what_is_only_like_the_thing_does_not_show_it(tmp_path: Path) -> None:
    names = ("duck", "sailboat", "lady beetle", "sheep flock")
    library = Library("photos", {name: ((name,), 0.8, RED) for name in names})
    index = PictureIndex([library], Poultry(), tmp_path)
    for name, caption, exact in (
        ("goose", "duck", False),
        ("duck", "duck", True),
        ("lady beetle", "lady beetle", True),
        ("sheep", "sheep flock", True),
    ):
        found = index.find(Thing(name, name.split()[-1]), f"a {name}", nowhere)
        assert found is not None and (found.caption, found.exact) == (caption, exact), name


def test_of_several_each_may_have_a_picture_of_its_own(tmp_path: Path) -> None:
    people = {str(at): (("man",), 0.8, color) for at, color in enumerate((RED, BLUE, GREEN))}
    index = PictureIndex(
        [Library("people", people), Library("others", {"4": (("man",), 0.8, RED)})], WordBag(), tmp_path
    )
    for count, others in ((1, 0), (2, 1), (3, 2), (9, 2)):
        found = index.find(Thing("man", "man", count=count), "men", nowhere)
        assert found is not None and len(found.others) == others


def test_for_a_living_thing_one_of_its_kind_stands(tmp_path: Path) -> None:
    known = {"1": (("dhole beetle",), 0.8, RED), "2": (("wolf",), 0.8, BLUE), "3": (("gear",), 0.8, GREEN)}
    index = PictureIndex([Library("pictures", known)], WordBag(), tmp_path)
    for among in (False, True):
        found = index.find(Thing("dhole", "dhole"), "a dhole", nowhere, cut_out=among)
        assert found is not None and found.caption == "wolf" and not found.exact
    assert index.find(Thing("dhole", "dhole"), "a dhole", nowhere, least=0.7) is None


class Silhouettes(Library):
    """One flat shape without colour for each."""

    def pictures(self, file: str) -> list[Tensor]:
        shape = torch.full((4, 40, 40), 0.25)
        shape[3], shape[3, :8] = 1.0, 0.0
        return [shape]


def test_a_silhouette_has_the_muted_colour_of_what_is_nearest_in_meaning(tmp_path: Path) -> None:
    shapes = Silhouettes("shapes", {"s": (("fox",), 0.0, GREEN)})
    index = PictureIndex([shapes, Library("models", {"4": (("fox den",), 0.6, RED), "6": (("bus",), 0.6, BLUE)})],
                         WordBag(), tmp_path)  # fmt: skip
    found = index.find(Thing("fox", "fox"), "a fox", nowhere)
    assert found is not None and found.library is shapes
    red, green, blue = found.picture[:3, 20, 20].tolist()
    assert red > green + 0.15 and red > blue + 0.15, "reddish"
    assert red < RED[0] - 0.1, "and muted"
    asked = index.find(Thing("fox", "fox", "black"), "a black fox", nowhere)
    assert asked is not None and asked.picture[:3].amax() < 0.3, "a colour that was asked for is given later"


def test_a_keyword_and_a_plural_say_what_a_picture_shows(tmp_path: Path) -> None:
    library = Library("models", {"1": (("stroller", "pram"), 0.6, RED), "2": (("lily pads",), 0.6, GREEN)})
    index = PictureIndex([library], Bag(), tmp_path)
    for name in ("pram", "lily pad"):
        found = index.find(Thing(name, name.split()[-1]), f"a {name}", nowhere)
        assert found is not None and found.exact, name


class Bag(WordBag):
    """A pad is nearly "pads", and a pram nearly a stroller."""

    def embed(self, sentences: Sequence[str]) -> Tensor:
        like = {"pad": "lily pads", "lily pad": "lily pads stem root leaf", "pram": "stroller pram"}
        return super().embed([like.get(sentence, sentence) for sentence in sentences])


def test_a_desk_lamp_shows_no_lamp_on_a_desk(tmp_path: Path) -> None:
    index = PictureIndex([Library("models", {"1": (("desk lamp",), 0.8, RED)})], WordBag(), tmp_path)
    both = Thing("lamp on desk", "lamp on desk")
    assert index.find(both, "a lamp on a desk", nowhere, least=0.5, shows=("lamp", "desk")) is None
    assert index.find(Thing("desk lamp", "lamp"), "a desk lamp", nowhere) is not None
