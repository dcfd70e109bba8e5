"""From a prompt to a scene: the account tells what the captions say, and what is missing is told once."""

from pathlib import Path

import pytest

from frida_painter.canvas_size import CanvasSize
from frida_painter.frames import PixelGrid
from frida_painter_words.libraries import SHIPPED, PictureArchive
from frida_painter_words.retrieval import PictureIndex
from frida_painter_words.scene import find_cutout, scene_of
from support.networks import QuickEncoders, WordBag
from words.test_retrieval import DRAWN, FOUND, archive

GRID = PixelGrid.of_height(CanvasSize.parse("40x30cm"), 48)


@pytest.fixture
def encoders(tmp_path: Path) -> QuickEncoders:
    libraries = [
        PictureArchive("fluent", "Somebody, MIT", archive(tmp_path / "found.zip", FOUND)),
        PictureArchive(SHIPPED, "", archive(tmp_path / "drawn.zip", DRAWN)),
    ]
    quick = QuickEncoders()
    quick.own["picture index"] = PictureIndex(libraries, WordBag(), tmp_path, quick.remark)
    return quick


@pytest.mark.parametrize(
    ("said", "account", "sentences"),
    [
        ("a fox in a meadow", "shown: 'fox', 'meadow'", 2),
        ("three foxes at night", "shown: 'three foxes', 'night'", 2),
        ("nine foxes", "shown: 'foxes'; not shown: 'nine'", 2),
        ("a blue fox", "shown: 'blue fox'", 2),
        ("a tired woman playing the cello", "shown: 'woman playing the cello'; not shown: 'tired'", 2),
        ("a meadow without people", "shown: 'meadow'; left out as you asked: 'people'", 2),
        ("joy", "shown: 'joy'", 2),
        ("a fox in the style of Monet", "shown: 'fox'", 3),
        ("Albert Einstein dancing", "not shown: 'Albert Einstein dancing'", 3),
        ("a fox and a zebra", "shown: 'fox'; not shown: 'zebra'", 3),
        ("an owl", "shown by something similar: 'owl' (by 'owls')", 2),
        ("a dog fox", "shown by something similar: 'dog fox' (by 'fox')", 2),
        ("a fox near trees", "shown: 'fox'; not shown: 'trees'", 2),
        ("a fox on a fox tooth", "shown: 'fox'; not shown: 'fox tooth'", 2),
        ("burning joy", "shown: 'joy'; shown by something similar: 'burning' (by 'joy')", 2),
    ],
)
def test_the_account_is_true_and_what_is_missing_is_told(
    encoders: QuickEncoders, said: str, account: str, sentences: int
) -> None:
    scene = scene_of(said, GRID, encoders)
    assert scene.picture.shape == (3, GRID.rows, GRID.columns) and bool(scene.picture.isfinite().all())
    assert f"Your words: {account}." in encoders.remarks and len(encoders.remarks) == sentences


def test_copies_fill_the_count(encoders: QuickEncoders) -> None:
    widths = [(scene_of(said, GRID, encoders).where > 0.5).any(0).sum() for said in ("a fox", "two foxes", "3 foxes")]
    assert widths == sorted(widths) and widths[0] < widths[-1]


def test_a_mood_fills_the_canvas_and_authors_are_told(encoders: QuickEncoders) -> None:
    scene_of("a fox", GRID, encoders)
    assert "Somebody, MIT" in encoders.remarks[0]
    assert bool((scene_of("grief", GRID, encoders).where == 1).all())


def test_a_thing_for_a_photograph_is_cut_out(encoders: QuickEncoders) -> None:
    cutout = find_cutout("a blue fox", encoders, "laid in")
    assert cutout is not None and cutout.phrase.color and float(cutout.picture[3].min()) == 0
    assert float(cutout.picture[2, 30, 30]) > float(cutout.picture[0, 30, 30])
    assert find_cutout("a meadow", encoders, "laid in") is None
