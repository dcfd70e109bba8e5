"""Kinds of nouns: what a dictionary says, and the file that is written from it."""

import runpy
from pathlib import Path

import pytest

from frida_painter.words.nouns import kind_of_name, kinds_of, senses_of

TOOL = Path(__file__).parents[2] / "tools" / "write_nouns.py"


@pytest.mark.parametrize(
    ("name", "kinds"),
    [
        ("violinist", "person"),
        ("old violinist", "person"),
        ("Violinists", "person"),
        ("children", "person"),
        ("fishermen", "person"),
        ("teapot", "thing"),
        ("alarm clock", "thing"),
        ("sunrise ZXQ", "thing"),
        ("grief", "idea"),
        ("tiger", "person thing"),
        ("choir", "person thing"),
        ("wrist", "body"),
    ],
)
def test_a_noun_may_be_what_its_senses_say(name: str, kinds: str) -> None:
    assert kinds_of(name) == set(kinds.split())


def test_the_files_are_written_from_a_dictionary(tmp_path: Path) -> None:
    folder = tmp_path / "dict"
    folder.mkdir()
    (tmp_path / "LICENSE").write_text("Some licence\n")
    kept = "  1 a line of the licence\n"
    (folder / "data.noun").write_text(
        f"{kept}00000001 18 n 01 lion 0 000 | a hero\n00000002 05 n 02 big_cat 0 cat 0 000 | a beast\n"
        "00000003 12 n 01 joy 0 000 | a feeling\n00000004 05 n 01 lion 0 001 @ 00000002 n 0000 | a cat\n"
        "00000005 05 n 01 Felidae 0 001 @ 00000002 n 0000 | Latin\n"
        "00000006 15 n 02 Lion_Rock 0 Lion 0 002 @i 00000007 n 0000 @i 00000008 n 0000 | a town\n"
        "00000007 15 n 01 port 0 000 | a haven\n00000008 15 n 01 national_capital 0 000 | a seat\n"
    )
    (folder / "index.noun").write_text(
        f"{kept}lion n 2 1 @ 2 0 00000004 00000001  \njoy n 1 1 @ 1 0 00000003  \nbig_cat n 1 1 @ 1 0 00000002  \n"
    )
    files = [tmp_path / name for name in ("nouns.txt", "senses.txt", "names.txt")]
    runpy.run_path(str(TOOL))["write_nouns"](folder, *files)
    read = [file.read_text("utf-8").splitlines() for file in files]
    assert all("# Some licence" in lines for lines in read)
    assert [[line for line in lines if line[0] != "#"] for lines in read] == [
        ["idea: joy", "person: children", "person thing: lion"],
        ["0 big cat, cat", "1 lion"],
        ["city: lion rock"],
    ]


@pytest.mark.parametrize(
    ("name", "kind"), [("Venice", "city"), ("new York", "state"), ("Nile", "river"), ("turkey", ""), ("cat", "")]
)
def test_a_place_with_a_name_is_told_from_things(name: str, kind: str) -> None:
    assert kind_of_name(name) == kind


def test_a_sense_is_a_kind_of_those_above_it() -> None:
    (oak, *_), (tree, *_) = senses_of("oak tree"), senses_of("trees")
    assert oak.is_kind_of(tree) and not tree.is_kind_of(oak)
    assert senses_of("ladybird") == senses_of("ladybug")
    assert senses_of("old pine cone") == senses_of("pinecone") and senses_of("zxq") == []
