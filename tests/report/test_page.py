import itertools
import re
from dataclasses import fields, replace
from html.parser import HTMLParser
from pathlib import Path

import pytest

from frida_painter.errors import StorageError
from frida_painter.report.page import page, write_page
from frida_painter.report.story import Download, Look, Phase, PictureComparison, Story, paints
from support.plans import made_up_plan

STORY = Story(
    title="Astronaut",
    summary="40 strokes in 5 colours on a canvas of 300 x 200 mm.",
    target="target.jpg",
    plan="planned.jpg",
    painting="painting.png",
    film="film.mp4",
    palette_sheet="palette.png",
    paints=paints(made_up_plan()),
    looks=(
        Look(
            10, "seen-10.jpg", "expected-10.jpg", "difference-10.png", "plan-10.jpg", 0.03, 0.02, "Marks are thinner."
        ),
        Look(20, "seen-20.jpg", "expected-20.jpg", "difference-20.png", "plan-20.jpg", 0.02, 0.01),
    ),
    phases=(Phase("first plan", ((0, 0.2), (1, 0.1), (2, 0.05))), Phase("after 10 strokes", ((0, 0.06), (1, 0.04)))),
    comparisons=(PictureComparison("the painting to the photograph", 18.24, 12.5),),
    facts=(("Seed", "7"), ("Brush", "medium")),
    downloads=(Download("plan.json", "the plan"), Download("strokes.svg", "for plotters")),
)


class Reader(HTMLParser):
    """Collects what a page names, and checks that its tags are closed in order."""

    EMPTY = ("meta", "img", "line", "br", "i")

    def __init__(self, html: str) -> None:
        super().__init__()
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.text = ""
        self._open: list[str] = []
        self.feed(html)
        assert self._open == []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))
        if tag not in ("meta", "img", "br"):
            self._open.append(tag)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))

    def handle_endtag(self, tag: str) -> None:
        assert self._open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.text += data

    def all(self, tag: str, name: str) -> list[str | None]:
        return [attributes[name] for found, attributes in self.tags if found == tag and name in attributes]


def test_the_page_shows_every_picture_of_the_story() -> None:
    reader = Reader(page(STORY))
    pictures = [STORY.target, STORY.plan, STORY.painting]
    for look in STORY.looks:
        pictures += [look.photograph, look.expected, look.difference, look.plan]
    assert set(pictures) == set(reader.all("img", "src"))
    assert reader.all("video", "src") == ["film.mp4"]
    links = set(reader.all("a", "href"))
    assert {"palette.png", "plan.json", "strokes.svg"} <= links


def test_the_page_says_what_the_story_says() -> None:
    text = " ".join(Reader(page(STORY)).text.split())
    for words in (
        "Astronaut",
        "40 strokes in 5 colours",
        "After 10 strokes",
        "Marks are thinner.",
        "0.03 before, 0.02",
    ):
        assert words in text
    assert "18.2" in text and "12.5" in text and "Seed7" in text and STORY.paints[0].hex in text
    assert "stopped before it was finished" not in text


def test_the_page_needs_no_network_and_no_script() -> None:
    html = page(STORY)
    assert not re.search(r"https?:|//[a-z]|@import|url\(|<script|<link", html)


def test_the_page_can_be_heard() -> None:
    reader = Reader(page(STORY))
    images = [attributes for tag, attributes in reader.tags if tag == "img"]
    assert images and all(attributes.get("alt") for attributes in images)
    levels = [int(tag[1]) for tag, _ in reader.tags if re.fullmatch(r"h[1-6]", tag)]
    assert levels[0] == 1 and levels.count(1) == 1
    assert all(later - earlier <= 1 for earlier, later in itertools.pairwise(levels))
    assert reader.all("html", "lang") == ["en"] and all(reader.all("video", "aria-label"))


def test_what_people_typed_is_text_and_never_markup() -> None:
    evil = '<script>alert(1)</script>"&\udcff'
    story = replace(
        STORY,
        title=evil,
        summary=evil,
        facts=((evil, evil),),
        phases=(Phase(evil, ((0, 1.0), (1, 0.5))),),
        downloads=(Download('a"b c.json', evil),),
        looks=(replace(STORY.looks[0], text=evil),),
    )
    html = page(story)
    assert "<script" not in html
    assert "a%22b%20c.json" in html
    html.encode("utf-8")
    Reader(html)


@pytest.mark.parametrize("field", [field.name for field in fields(Story) if field.default == ()])
def test_each_part_may_be_missing(field: str) -> None:
    Reader(page(replace(STORY, **{field: ()})))


def test_a_painting_that_was_stopped_early_says_so() -> None:
    story = replace(STORY, stopped=True, painting=None, film=None, palette_sheet=None, looks=(), phases=())
    reader = Reader(page(story))
    assert "stopped before it was finished" in reader.text
    assert set(reader.all("img", "src")) == {STORY.target, STORY.plan}
    assert reader.all("video", "src") == []
    assert "The unfinished canvas" in page(replace(STORY, stopped=True))


def test_the_page_is_written_whole(tmp_path: Path) -> None:
    path = write_page(STORY, tmp_path)
    assert path.name == "index.html" and path.read_text(encoding="utf-8") == page(STORY)
    (tmp_path / "file").write_text("")
    with pytest.raises(StorageError):
        write_page(STORY, tmp_path / "file")


def test_text_can_be_read_in_light_and_dark() -> None:
    """Contrast of 4.5 and more between text and paper (WCAG 2.2, 1.4.3)."""

    def luminance(color: str) -> float:
        parts = [int(color[start : start + 2], 16) / 255 for start in (1, 3, 5)]
        linear = [part / 12.92 if part <= 0.04045 else ((part + 0.055) / 1.055) ** 2.4 for part in parts]
        return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]

    themes = re.findall(r":root \{(.*?)\}", page(STORY), re.DOTALL)
    assert len(themes) == 2
    for theme in themes:
        colors = dict(re.findall(r"--(\w+): (#[0-9a-f]{6});", theme))
        for text in ("ink", "soft", "accent"):
            dark, light = sorted((luminance(colors[text]), luminance(colors["paper"])))
            assert (light + 0.05) / (dark + 0.05) >= 4.5, text
