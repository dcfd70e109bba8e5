"""Every state that the page can be in: status, role, connection and device, each drawn in a real browser.

`make views` draws them, and keeps them as sheets for people in docs/lab/views; `make test` does not.
"""

import os
import shutil
from collections.abc import Iterator
from contextlib import ExitStack, nullcontext
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any, get_args

import numpy as np
import pytest
import torch
from PIL import Image, ImageDraw
from playwright.sync_api import Browser, BrowserContext, Page, Route, expect

from browsing import WITH_CHROMIUM, complaints, require_stop_on_top
from frida_painter.report.painters import Painters
from frida_painter.session.events import (
    Advanced,
    Began,
    Drying,
    Event,
    PaintsWanted,
    ResultFound,
    Stopped,
    Turns,
)
from frida_painter.system import storage
from frida_painter_studio.painting_state import Stage
from frida_painter_studio.workers import QUEUE
from served import Served, opened_studio
from support.told import (
    BEGUN,
    FINISHED,
    LOOKED,
    MADE,
    MIXTURES,
    PAINTED,
    PAUSED,
    PERSON,
    PICTURES,
    PLANNED,
    PROTECTED,
    REQUEST,
    Told,
)

pytestmark = [WITH_CHROMIUM, pytest.mark.timeout(560)]
NIGHTLY = pytest.mark.skipif(not os.environ.get("EVERY_VIEW"), reason="`make views` draws all views")

ROOT = Path(__file__).parents[2]
SHEETS = ROOT / "docs/lab/views"

REQUESTED = PLANNED[0]
GROWING: list[Event] = [Advanced("", 0.4, 21.0), Advanced(picture="after-40.jpg")]
STOPPED, TROUBLE = Stopped(), Stopped("The serial line /dev/ttyUSB0 is gone (no such device); look at its cable.")
DRYING = Drying(3, 600.0)
STATES: dict[Stage, tuple[list[Event], bool]] = {  # its events, and if a process is at work
    "waiting": ([REQUESTED], False),
    "planning": ([REQUESTED, *GROWING], True),
    "plan stopped": ([REQUESTED, *GROWING, STOPPED], False),
    "plan failed": ([REQUESTED, Stopped("The disk is full; make room on it.")], False),
    "planned": ([*PLANNED], False),
    "queued": ([*PLANNED], False),
    "preparing": ([*PLANNED, *BEGUN], True),
    "mixing": ([*PLANNED, *BEGUN, PaintsWanted(("#c06030",))], True),
    "painting": ([*PLANNED, *PAINTED], True),
    "drying": ([*PLANNED, *PAINTED, DRYING], True),
    "replanning": ([*PLANNED, *PAINTED, LOOKED], True),
    "paused": ([*PLANNED, *PAINTED, *PROTECTED, PAUSED], True),
    "finishing": ([*PLANNED, *PAINTED, *FINISHED[:-1]], True),
    "finished": ([*PLANNED, *PAINTED, *FINISHED], False),
    "stopped": ([*PLANNED, *PAINTED, STOPPED], False),
    "failed": ([*PLANNED, *PAINTED, TROUBLE], False),
    "lost": ([*PLANNED, *PAINTED], False),
}
PLACES = {"gallery": "#/", "new": "#/new", "calibrate": "#/calibrate", "teach": "#/teach"}
TOGETHER = {**REQUEST, "terms": [], "together": True, "brushes": "medium"}
WITHOUT_GOAL: list[Event] = [
    Began("plan", plan=1, detail=TOGETHER),
    ResultFound("plan", plan=1, detail={**MADE, **MIXTURES, "strokes": 0, "frames": [0]}),
]
TURNS = Turns(3, policy="continue", keep="protect")
KEPT_BY_TWO = [*FINISHED[:-1], ResultFound("results", detail={"film": True, "painters": True})]
TOGETHERS: dict[str, tuple[list[Event], bool]] = {  # stages of a person who paints, too
    "no goal, planned": (WITHOUT_GOAL, False),
    "no goal, your turn": ([*WITHOUT_GOAL, Began("paint", plan=1), *BEGUN[1:], *PERSON, TURNS, PAUSED], True),
    "form of turns": ([*PLANNED, *PAINTED, *PERSON, PAUSED], True),
    "who painted what": ([*PLANNED, *PAINTED, *PERSON, *KEPT_BY_TWO], False),
}
STATUSES = (*STATES, *TOGETHERS, *PLACES)
ANSWER = "The robot's answer to what you paint"
ROLES = ("watch", "plan", "operate")
CONNECTIONS = ("connected", "cut")
DEVICES: dict[str, dict[str, Any]] = {
    "desk": {"viewport": {"width": 1440, "height": 900}, "color_scheme": "light"},
    "phone": {"viewport": {"width": 390, "height": 844}, "color_scheme": "dark", "has_touch": True, "is_mobile": True},
}


@dataclass(frozen=True)
class View:
    status: str  # a stage of a painting, or a place of the page
    role: str
    connection: str
    device: str

    @property
    def name(self) -> str:
        return f"{self.status.replace(' ', '-')}-{self.role}-{self.connection}-{self.device}"


def all_views() -> list[View]:
    return [View(*each) for each in product(STATUSES, ROLES, CONNECTIONS, DEVICES)]


def test_every_stage_has_its_state() -> None:
    assert set(STATES) == set(get_args(Stage))


@pytest.fixture(scope="module")
def studio(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    with opened_studio(tmp_path_factory.mktemp("studio") / "paintings", "--pace", "0.05") as opened:
        goal, *_ = coffee()
        for name in PICTURES:
            goal.save(opened.folder / "pictures" / f"{name}.png")
        yield opened


@pytest.fixture(scope="module")
def paintings(studio: Served) -> Iterator[dict[str, Told]]:
    """A painting in every stage."""
    _, plan, canvas = coffee()
    with ExitStack() as stack:
        told: dict[str, Told] = {}
        for stage, (events, works) in {**STATES, **TOGETHERS}.items():
            bare = Image.new("RGB", canvas.size, (247, 245, 240))
            pictures = (
                dict.fromkeys(("plan", "canvas"), bare) if "no goal" in stage else {"plan": plan, "canvas": canvas}
            )
            told[stage] = Told(studio, *events, title=stage.capitalize(), pictures=pictures)
            if stage == "who painted what":
                keep_painters(told[stage].folder.painting, canvas)
            stack.enter_context(told[stage].at_work() if works else nullcontext())
        shutil.rmtree(told["lost"].folder.path)
        keep_queue(studio, told)
        yield told


def keep_queue(studio: Served, told: dict[str, Told]) -> None:
    """Writes the queue, held by a stop, and starts the studio again: it finds the paintings that wait."""
    jobs = {"waiting": "plan", "queued": "paint"}
    (studio.folder / QUEUE).mkdir()
    (studio.folder / QUEUE / "stop").touch()
    waiting = [{"painting": told[stage].id, "plan": 1, "job": job} for stage, job in jobs.items()]
    storage.write_json(studio.folder / QUEUE / "queue.json", {"entries": waiting})
    studio.fall_over_and_be_started_again()


def keep_painters(folder: Path, canvas: Image.Image) -> None:
    """Writes who painted what: the robot the upper half of a canvas, the person most of the lower one."""
    rows, columns = canvas.height, canvas.width
    owner = np.zeros((rows, columns), np.int32)
    owner[: rows // 2], owner[rows // 2 :, : 2 * columns // 3] = 7, -2
    picture = torch.from_numpy(np.array(canvas)).permute(2, 0, 1).float() / 255
    Painters(owner).save(folder, picture)


def coffee() -> list[Image.Image]:
    """Goal, plan and canvas of a painting, small."""
    side_by_side = Image.open(ROOT / "docs/images/coffee.jpg")
    third, height = side_by_side.width // 3, side_by_side.height
    crops = [side_by_side.crop((number * third, 0, number * third + 4 * height // 3, height)) for number in range(3)]
    return [crop.resize((480, 360)) for crop in crops]


def open_as(browser: Browser, studio: Served, role: str, device: str) -> tuple[BrowserContext, Page]:
    context = browser.new_context(**DEVICES[device])
    context.add_init_script("delete window.SharedWorker")  # a browser that is told to be offline leaves it its stream

    def as_role(route: Route) -> None:
        route.fulfill(json={**route.fetch().json(), "role": role})

    context.route("**/api/studio", as_role)
    page = context.new_page()
    page.goto(studio.address)
    page.wait_for_url("**/#/")
    expect(page.get_by_text("What do you want to paint?")).to_be_visible()
    return context, page


def show(page: Page, paintings: dict[str, Told], view: View) -> None:
    if view.status in PLACES:
        page.evaluate("place => { location.hash = place; }", PLACES[view.status])
    else:
        paintings[view.status].show(page)
        expect(page.locator(".workbench h1")).to_be_visible()
    expect(page.locator("main h1:visible").first).to_be_visible()
    expect(page.locator("main [aria-busy]")).to_have_count(0)
    if view.status == "form of turns" and view.role == "operate":
        form = page.locator("details", has_text=ANSWER)
        if form.get_attribute("open") is None:
            form.locator("summary").click()
        expect(form.get_by_label(ANSWER)).to_be_visible()
    if view.status == "who painted what":
        shares = page.locator(".painters-key", has_text="bare canvas: 17 %")
        shares.scroll_into_view_if_needed()
        expect(shares).to_be_visible()
    eager = "[...document.images].filter((image) => image.loading !== 'lazy' && image.src)"
    page.evaluate(f"Promise.all({eager}.map((image) => image.decode().catch(() => {{}})))")


def cut(context: BrowserContext, page: Page) -> None:
    context.set_offline(True)
    expect(page.locator("#connection")).not_to_be_empty()


def require_whole(page: Page, view: View) -> None:
    """Whatever is shown: Stop is in reach and under nothing, one heading names the view, nothing is too wide."""
    stop = page.locator("#stop").bounding_box()
    assert stop is not None, view
    assert stop["x"] >= 0 and stop["x"] + stop["width"] <= page.evaluate("innerWidth"), (view, stop)
    require_stop_on_top(page)
    assert page.locator("h1:visible").count() == 1, view
    assert page.evaluate("document.documentElement.scrollWidth <= innerWidth"), view
    text = page.locator("body").inner_text()
    assert not [word for word in ("undefined", "NaN", "null", "[object") if word in text], (view, text)


def draw(browser: Browser, studio: Served, paintings: dict[str, Told], views: list[View], folder: Path) -> list[str]:
    """Draws the views, and returns what axe finds in them."""
    found: list[str] = []
    folder.mkdir(parents=True, exist_ok=True)
    for role, device in product(ROLES, DEVICES):
        wanted = [view for view in views if (view.role, view.device) == (role, device)]
        if not wanted:
            continue
        context, page = open_as(browser, studio, role, device)
        for view in sorted(wanted, key=lambda each: (each.status, each.connection != "connected")):
            show(page, paintings, view)
            if view.connection == "cut":
                cut(context, page)
            require_whole(page, view)
            found += [f"{view.name}: {each}" for each in complaints(page)]
            page.screenshot(path=folder / f"{view.name}.png")
            if view.connection == "cut":
                context.set_offline(False)
                expect(page.locator("#connection")).to_be_empty()
        context.close()
    return found


@NIGHTLY
def test_every_state_of_the_page_is_whole(
    browser: Browser, studio: Served, paintings: dict[str, Told], tmp_path: Path
) -> None:
    views = all_views()
    found = draw(browser, studio, paintings, views, tmp_path)
    assert not found, "\n".join(found)
    for device in DEVICES:
        draw_sheet(views, device, tmp_path).save(SHEETS / f"{device}.jpg", quality=68)


def draw_sheet(views: list[View], device: str, folder: Path) -> Image.Image:
    """One row for each status, one column for each role and connection."""
    width, height = (360, 225) if device == "desk" else (156, 338)
    columns = list(product(ROLES, CONNECTIONS))
    sheet = Image.new("RGB", (90 + len(columns) * (width + 8), 24 + len(STATUSES) * (height + 8)), "white")
    pen = ImageDraw.Draw(sheet)
    for column, (role, connection) in enumerate(columns):
        pen.text((90 + column * (width + 8), 6), f"{role}, {connection}", fill="black")
    for row, status in enumerate(STATUSES):
        top = 24 + row * (height + 8)
        pen.text((4, top + 4), status, fill="black")
        for column, (role, connection) in enumerate(columns):
            view = View(status, role, connection, device)
            with Image.open(folder / f"{view.name}.png") as drawn:
                sheet.paste(drawn.convert("RGB").resize((width, height)), (90 + column * (width + 8), top))
    return sheet
