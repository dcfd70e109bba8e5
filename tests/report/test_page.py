import itertools
import re
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import pytest
import torch

from frida_painter.errors import StorageError
from frida_painter.mixing.paint import usual_paints
from frida_painter.mixing.recipe import PaintSet
from frida_painter.mixing.shopping import paints_by_brush, supplies
from frida_painter.report.page import page, write_page
from frida_painter.report.recorder import Description
from frida_painter.report.story import PictureComparison
from frida_painter.session.events import Looked, NewGoal, Planned
from frida_painter.session.fold import BrushState, End, PaintingState, PlanningState, Sittings, StrokeProgress, Wishes
from frida_painter.session.progress import Painting
from support.plans import made_up_plan

LOOKS = [
    (
        Looked(done, {part: f"{part}-{done}.jpg" for part in ("seen", "expected", "difference")}),
        Planned(done, 40 - done, 0.03, 0.02, (20.0, 19.5, 20.5), look=f"plan-{done}.jpg"),
    )
    for done in (1, 20)
]
PHASES = [("first plan", [(0, 0.2), (1, 0.1), (2, 0.05)]), ("after 10 strokes", [(0, 0.06), (1, 0.04)])]
PAPER = torch.ones(3, 4, 6)
DESCRIBED = Description("Astronaut", PAPER, (("Seed", "7"), ("Brush", "medium")), {}, 60)
STATE = PaintingState(
    sittings=Sittings(count=2),
    progress=StrokeProgress(given_up=[3]),
    brush=BrushState(dips={0: 7}, touch={"medium": "It is sent lower."}),
    planning=PlanningState(phases=PHASES, forecasts=[(0, (20.0, 19.5, 20.5))], expected_seconds=90.0),
    wishes=Wishes(goals=[NewGoal("changes/1", {}, facts=("Words: a fox", "Style"), done=4)]),
)
_PLAN = made_up_plan(40)
PAINTS = paints_by_brush(_PLAN, PaintSet(usual_paints()).mix(_PLAN.palette.color))
STORY: dict[str, Any] = {
    "described": DESCRIBED,
    "state": STATE,
    "plan": _PLAN,
    "painting": Painting(PAPER, 40, None, 60.0, "The last photograph is dark."),
    "has_film": True,
    "paints": PAINTS,
    "supplies": supplies(PAINTS),
    "looks": LOOKS,
    "comparisons": (PictureComparison("the painting to the photograph", 18.24, 12.5, (340, 256)),),
    "watched": True,
    "left_out": 2,
    "size": (3556, 2372),
    "has_card": True,
    "arm_film": "",
}


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
    pictures = ["target.jpg", "plan.png", "canvas.png"]
    for look, planned in LOOKS:
        pictures += [*look.pictures.values(), planned.look]
    assert set(pictures) == set(reader.all("img", "src"))
    assert reader.all("video", "src") == ["film.mp4"]
    links = set(reader.all("a", "href"))
    files = {"palette.png", "mixing.png", "shopping.png", "shopping.txt", "plan.json", "strokes.svg"}
    assert files | {"painting.png", "card.jpg"} <= links


def test_the_page_says_what_the_story_says() -> None:
    text = " ".join(Reader(page(STORY)).text.split())
    for words in (
        "Astronaut",
        "40 strokes in 5 paints on a canvas of 300 x 200 mm, 2 looks in between.",
        "Goal changedafter 4 strokes: Words: a fox; Style",
        "Similarity forecast by the first plan20.0 dB expected, 19.5 to 20.5",
        "Strokes40 of 40",
        "Dips into paint7",
        "Sittings2",
        "Strokes given up3",
        "Brush heightsIt is sent lower.",
        "Last lookThe last photograph is dark.",
        "Pictures left out2, for want of space on the disk",
        "Robot's clock1.0 min, 1.5 expected",
        "After 20 strokes",
        "After 1 stroke the painter looked, and planned the 39 that were left again",
        "should come 33 % nearer to the goal than if it had gone on blindly",
        "(PSNR): 20.0 dB expected, 19.5 to 20.5.",
        "To print, 3556 x 2372 pixels",
        "1 stroke 20 strokes 40 strokes As expected",  # the looks in a row
    ):
        assert words in text
    assert "loss" not in text.lower()
    assert "18.2" in text and "12.5" in text and "Seed7" in text
    for brush in PAINTS:
        assert brush.title in text and all(mixture.recipe.words in text for mixture in brush.mixtures)
    assert all(supply.paint.title in text and supply.in_tubes in text for supply in STORY["supplies"])
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
    look = LOOKS[0][0], replace(LOOKS[0][1], look='a"b c.png')
    phases = [(evil, [(0, 1.0), (1, 0.5)])]
    described = replace(DESCRIBED, title=evil, facts=((evil, evil),))
    html = page(
        {
            **STORY,
            "described": described,
            "state": replace(STATE, planning=PlanningState(phases=phases)),
            "looks": [look],
        }
    )
    assert "<script" not in html
    assert "a%22b%20c.png" in html
    html.encode("utf-8")
    Reader(html)


@pytest.mark.parametrize(
    "field", ["has_film", "has_card", "supplies", "paints", "looks", "comparisons", "watched", "left_out"]
)
def test_each_part_may_be_missing(field: str) -> None:
    Reader(page({**STORY, field: ()}))
    Reader(page({**STORY, field: (), "described": replace(DESCRIBED, target=None, facts=(), has_camera=False)}))


def test_a_painting_that_was_stopped_early_says_so() -> None:
    reader = Reader(page({**STORY, "state": PaintingState(end=End(stopped=True)), "has_film": False, "looks": ()}))
    assert "stopped before it was finished" in reader.text and "The unfinished canvas" in reader.text
    assert set(reader.all("img", "src")) == {"target.jpg", "plan.png", "canvas.png"}
    assert reader.all("video", "src") == []


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
