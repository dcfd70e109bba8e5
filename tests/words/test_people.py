from frida_painter.words.arrangement import with_figures
from frida_painter.words.reading import Reading, Relation, Thing


def nobody(thing: Thing) -> bool:
    return False


def people(noun: str, *, count: int | None = 1, doing: str = "", name: str = "", alone: bool = False) -> list[str]:
    """Names and numbers of the people of a reading in which somebody is on a beach, unless `alone`."""
    somebody = Thing(name or noun, noun, count=count, doing=doing)
    beach = () if alone else (Thing("beach", "beach"),)
    reading = with_figures(Reading((somebody, *beach), (Relation(0, "on", 1),) if beach else ()), nobody)
    return [f"{thing.shown} {thing.name}" for thing in reading.things if thing.noun != "beach"]


def test_people_are_shown_by_women_and_men_and_children_by_girls_and_boys() -> None:
    assert people("couple") == ["1 woman", "1 man"]
    assert people("couple", name="old couple") == ["1 old woman", "1 old man"]
    assert people("child", count=2) == ["1 girl", "1 boy"]
    assert people("child", count=5) == ["3 girl", "2 boy"]
    assert people("people", count=None) == ["2 woman", "1 man"]
    assert people("person") == ["1 woman"] and people("father", count=3) == ["3 man"]


def test_the_second_of_two_stands_beside_the_first_and_does_the_same() -> None:
    reading = with_figures(Reading((Thing("couple", "couple", doing="dancing"),)), nobody)
    assert [thing.doing for thing in reading.things] == ["dancing", "dancing"]
    assert reading.relations == (Relation(1, "beside", 0),)


def test_a_portrait_and_things_stay() -> None:
    assert people("child", alone=True) == ["1 child"] and people("horse", count=2) == ["2 horse"]
    assert people("couple", alone=True) == ["1 woman", "1 man"], "two people in any case"
    assert people("child", alone=True, doing="running") == ["1 girl"]


def test_more_than_fits_stays_as_it_is_said() -> None:
    crowd = tuple(Thing("child", "child", count=2, doing="playing") for _ in range(12))
    assert len(with_figures(Reading(crowd), nobody).things) == 12


def test_whom_a_persons_own_picture_shows_stays() -> None:
    reading = Reading((Thing("child", "child", doing="running"), Thing("father", "father", doing="running")))
    found = with_figures(reading, lambda thing: thing.noun == "child")
    assert [thing.name for thing in found.things] == ["child", "man"]
