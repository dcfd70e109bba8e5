"""Pictures are found by their captions and become a scene; none stands for what its caption does not name."""

import io
import json
import zipfile
from collections.abc import Mapping
from pathlib import Path

import pytest
from PIL import Image

from frida_painter.canvas_size import CanvasSize
from frida_painter.frames import PixelGrid
from frida_painter_words.libraries import SHIPPED, PictureArchive, PictureFolder
from frida_painter_words.reading import read
from frida_painter_words.retrieval import FoundPicture, PictureIndex
from frida_painter_words.scene import find_cutout, scene_of
from support.networks import QuickEncoders, WordBag

DRAWN = {
    "subject/1.webp": ["a woman playing the cello", "a cellist"],
    "subject/2.webp": ["a woman playing the violin"],
    "subject/3.webp": ["an old man reading"],
    "subject/4.webp": ["a boy flying a kite", "a child flying a kite"],
    "ground/1.webp": ["a meadow", "a meadow with trees"],
    "ground/2.webp": ["a meadow at night"],
    "ground/3.webp": ["a street in the rain"],
    "mood/1.webp": ["joy", "happiness"],
    "mood/2.webp": ["grief"],
}
FOUND = {"1.png": ["fox", "animal", "grief"], "2.png": ["hot dog"], "3.png": ["dog"], "4.png": ["Napoleon Bonaparte"],
         "5.png": ["tooth"], "6.png": ["owls"]}  # fmt: skip


def archive(path: Path, captions: Mapping[str, list[str]]) -> Path:
    with zipfile.ZipFile(path, "w") as packed:
        for number, file in enumerate(captions):
            content, opaque = io.BytesIO(), not file.startswith(("ground", "mood"))
            picture = Image.new("RGBA", (40, 40), (40 + 20 * number, 90, 60, 255))
            if opaque:
                picture.paste((0, 0, 0, 0), (0, 0, 20, 10))
            picture.save(content, file.rpartition(".")[2].upper(), lossless=True)
            packed.writestr(file, content.getvalue())
        packed.writestr("captions.json", json.dumps(captions))
    return path


@pytest.fixture(scope="module")
def index(tmp_path_factory: pytest.TempPathFactory) -> PictureIndex:
    folder = tmp_path_factory.mktemp("index")
    libraries = [
        PictureArchive("fluent", "Somebody", archive(folder / "found.zip", FOUND)),
        PictureArchive(SHIPPED, "", archive(folder / "drawn.zip", DRAWN)),
    ]
    return PictureIndex(libraries, WordBag(), folder, print)


def subject(index: PictureIndex, said: str) -> str | None:
    reading = read(said, index.knows)
    found = index.find_subject(reading.subjects[0], reading)
    return None if found is None else found.caption.text


@pytest.mark.parametrize(
    ("said", "caption"),
    [
        ("a fox in the snow", "fox"),
        ("a dog", "dog"),
        ("a woman playing the cello", "a woman playing the cello"),
        ("a child flying a kite", "a child flying a kite"),
        ("an old man", "an old man reading"),
        ("Napoleon Bonaparte on a horse", "napoleon bonaparte"),
        ("an animal", None),  # a keyword names nothing
        ("a dentist", None),
        ("an old woman", None),  # another woman
        ("Albert Einstein dancing", None),
        ("Joseph Bonaparte", None),  # his brother
        ("a meadow", None),  # a ground
        ("joy", None),
        ("a fox without animals", "fox"),
        ("a woman without violins", "a woman playing the cello"),
        ("a young woman playing the violin", "a woman playing the violin"),
        ("a man reading", None),  # an old man is another
    ],
)
def test_a_picture_stands_only_for_what_its_caption_names(index: PictureIndex, said: str, caption: str | None) -> None:
    assert subject(index, said) == caption


@pytest.mark.parametrize(
    ("words", "caption"),
    [("in a meadow", "a meadow"), ("in a meadow at night", "a meadow at night"), ("at night", "a meadow at night"),
     ("in the rain", "a street in the rain"), ("in a bathtub", None)],
)  # fmt: skip
def test_a_ground_has_the_place_the_light_or_the_weather(index: PictureIndex, words: str, caption: str | None) -> None:
    found = index.find_ground(read(f"a fox {words}", index.knows))
    assert (None if found is None else found.caption.text) == caption


def test_a_mood_is_the_nearest(index: PictureIndex) -> None:
    found = index.find_mood(read("happiness", index.knows))
    assert isinstance(found, FoundPicture) and found.caption.text == "happiness" and "joy" in found.caption.says


def test_the_persons_own_pictures_come_first_and_need_only_have_the_word(tmp_path: Path) -> None:
    Image.new("RGB", (40, 40), "red").save(tmp_path / "our fox at home.png")
    (tmp_path / "our dog.png").write_bytes(b"damaged")
    found = PictureArchive("fluent", "Somebody", archive(tmp_path / "found.zip", FOUND))
    told: list[str] = []
    index = PictureIndex([PictureFolder(tmp_path), found], WordBag(), tmp_path, told.append)
    assert subject(index, "a fox") == "our fox at home" and subject(index, "a dog") == "dog"
    assert len(told) == 1 and "our dog.png" in told[0]


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
