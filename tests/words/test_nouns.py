"""Kinds of nouns: what a dictionary says, and the file that is written from it."""

import runpy
from pathlib import Path

import pytest

from frida_painter.words.nouns import kinds_of

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


def test_the_file_is_written_from_a_dictionary(tmp_path: Path) -> None:
    folder = tmp_path / "dict"
    folder.mkdir()
    (tmp_path / "LICENSE").write_text("Some licence\n")
    kept = "  1 a line of the licence\n"
    (folder / "data.noun").write_text(f"{kept}00000001 18 n 01 x\n00000002 05 n 01 x\n00000003 12 n 01 x\n")
    (folder / "index.noun").write_text(
        f"{kept}lion n 2 1 @ 2 0 00000002 00000001  \nrose n 1 1 @ 1 0 00000002  \njoy n 1 1 @ 1 0 00000003  \n"
        "sea_lion n 1 1 @ 1 0 00000001  \n"
    )
    runpy.run_path(str(TOOL))["write_nouns"](folder, tmp_path / "nouns.txt")
    lines = (tmp_path / "nouns.txt").read_text("utf-8").splitlines()
    assert "# Some licence" in lines
    assert [line for line in lines if line[0] != "#"] == ["idea: joy", "person: children", "person thing: lion"]
