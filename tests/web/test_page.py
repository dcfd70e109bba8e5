"""The page as people use it: with a mouse, on a phone, by keyboard alone; on paintings of which it is told here."""

import contextlib
import json
import re
from collections.abc import Iterator
from typing import Any

import pytest
from PIL import Image
from playwright.sync_api import Browser, Page, Route, expect

from browsing import SCREENSHOTS, WITH_CHROMIUM, OpenStudio, chromium, deadline, opened_studio, window
from frida_painter.event_log import FEED, EventLog
from frida_painter.web.store import PaintingStore
from frida_painter.web.studio_folder import PaintingFolder, WorkerLock

pytestmark = [pytest.mark.slow, WITH_CHROMIUM]

PHONE: dict[str, Any] = {"has_touch": True, "is_mobile": True}
PICTURES = {"a" * 32: (200, 90, 40), "b" * 32: (40, 90, 200)}
REQUEST = {
    "title": "Cup", "terms": [{"kind": "image", "picture": "a" * 32, "weight": 1}], "initial": [], "strokes": 40,
    "colors": 2, "width": 120, "height": 90, "brushes": "broad", "replans": 2, "effort": 1, "seed": 0,
}  # fmt: skip
CHANGED = {**REQUEST, "terms": [*REQUEST["terms"], {"kind": "sketch", "picture": "b" * 32, "weight": 2}]}  # type: ignore[misc]
PALETTE = [
    {"number": 1, "hex": "#c06030", "strokes": 20, "share": 0.5},
    {"number": 2, "hex": "#203050", "strokes": 20, "share": 0.5},
]
MIXTURES = [{"recipe": "1 red", "millilitres": 3.0, "near": True}] * 2
MADE = {"prefix": "", "frames": [0, 40], "strokes": 40, "palette": PALETTE}
PLANNED: list[dict[str, Any]] = [
    {"kind": "plan_requested", "plan": 1, "wish": REQUEST},
    {"kind": "plan_made", "plan": 1, "nearer": 0.5, "seconds": 10.0, "mixtures": MIXTURES, **MADE},
]
PAINTED: list[dict[str, Any]] = [
    {"kind": "painting_started", "plan": 1, "of": 40},
    {"kind": "dipped", "paint": 1},
    *({"kind": "stroke_painted", "done": done, "of": 40} for done in (1, 2, 3)),
    {"kind": "photograph_shown", "picture": "photograph-00000.jpg", "done": 3},
]
PAUSED = {"kind": "paused", "reason": "It has paused.", "done": 3, "turn": False}
PROTECTED: list[dict[str, Any]] = [
    {"kind": "considering"},
    {"kind": "region_protected", "region": "regions/1.png", "only": False, "picture": "region-1.png"},
    {"kind": "look_shown", "done": 3, "seen": "look.jpg", "expected": "look.jpg", "difference": "look.jpg"},
    {"kind": "rest_replanned", "done": 3, "gain": -0.2, **MADE, "strokes": 37, "prefix": "plan-1-"},
]
FINISHED: list[dict[str, Any]] = [
    *({"kind": "stroke_painted", "done": done, "of": 40} for done in range(4, 41)),
    {"kind": "finishing"}, {"kind": "painting_kept", "film": True}, {"kind": "rests"},
]  # fmt: skip


@pytest.fixture(scope="module")
def studio(tmp_path_factory: pytest.TempPathFactory) -> Iterator[OpenStudio]:
    with opened_studio(tmp_path_factory.mktemp("studio") / "paintings") as opened:
        for name, color in PICTURES.items():
            Image.new("RGB", (120, 90), color).save(opened.folder / "pictures" / f"{name}.png")
        yield opened


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    with deadline(), chromium() as opened:
        yield opened


@pytest.fixture(scope="module")
def desk(browser: Browser, studio: OpenStudio) -> Iterator[Page]:
    with window(browser, studio, 1440, 900) as opened:
        yield opened


@pytest.fixture(scope="module")
def phone(browser: Browser, studio: OpenStudio) -> Iterator[Page]:
    with window(browser, studio, 390, 844, color_scheme="dark", **PHONE) as opened:
        yield opened


class Told:
    """A painting of which the page is told, although nobody paints."""

    def __init__(self, studio: OpenStudio, *lines: dict[str, Any]) -> None:
        entry = PaintingStore(studio.folder).begin("Cup")
        self.id, self.folder = entry.id, entry.folder
        plan, live, painting = self.folder.path / "plans/1", self.folder.live, self.folder.painting
        for folder in (plan, live):
            folder.mkdir(parents=True)
        (plan / "plan.json").write_text("{}")
        for name in ("photograph-00000", "look", "plan-1-plan"):
            Image.new("RGB", (120, 90), (250, 250, 250)).save(live / f"{name}.jpg")
        for name in ("plan", "after-0", "after-40"):
            Image.new("RGB", (120, 90), (30, 200, 90)).save(plan / f"{name}.jpg")
        if any(line["kind"] == "painting_started" for line in lines):
            painting.mkdir()
            Image.new("RGB", (120, 90), (250, 0, 250)).save(painting / "painting.png")
        Image.new("L", (120, 90), 255).save(live / "region-1.png")
        paths = {"height": 750, "paths": [[[100, 100], [300, 300]]] * 40, "widths": [40] * 40, "paint": [0, 1] * 20}
        for strokes in (plan / "strokes.json", live / "plan-1-strokes.json"):
            strokes.write_text(json.dumps(paths))
        self._log = EventLog(self.folder.feed, FEED)
        self.tell(*lines)

    def tell(self, *lines: dict[str, Any]) -> None:
        for line in lines:
            self._log.append(line)

    def show(self, page: Page) -> None:
        page.evaluate("id => { location.hash = `#/p/${id}`; }", self.id)

    @contextlib.contextmanager
    def at_work(self) -> Iterator[None]:
        """Somebody holds what a worker holds."""
        lock = WorkerLock(self.folder)
        assert lock.take()
        try:
            yield
        finally:
            lock.release()


def go(page: Page, place: str) -> None:
    page.evaluate("place => { location.hash = place; }", place)


def keep(page: Page, name: str) -> None:
    """A screenshot for people."""
    page.screenshot(path=SCREENSHOTS / f"page-{name}.png")


def lead(page: Page) -> None:
    """This page gives the orders from now on; the page of another test may not have given that back yet."""
    page.evaluate("async () => { await (await import('/static/api.js')).post('/api/lead'); }")


def in_sight(page: Page, selector: str) -> bool:
    """Whether all of an element can be seen, below the header."""
    found = page.locator(selector).bounding_box()
    size, header = page.viewport_size, page.locator(".bar").bounding_box()
    assert found is not None and size is not None and header is not None
    return found["y"] >= header["height"] and found["y"] + found["height"] <= size["height"]


def focused(page: Page) -> str:
    """What the keyboard's focus is on, as text."""
    return str(
        page.evaluate("(document.activeElement.getAttribute('aria-label') ?? document.activeElement.textContent)")
    )


def test_on_a_phone_the_header_is_low_and_nothing_is_wider_than_the_screen(phone: Page, studio: OpenStudio) -> None:
    painting = Told(studio, *PLANNED)
    for place in ("#/", "#/new", "#/calibrate", f"#/p/{painting.id}"):
        go(phone, place)
        expect(phone.locator("h1")).to_be_visible()
        assert phone.evaluate("document.querySelector('.bar').offsetHeight") <= 64
        assert phone.evaluate("document.documentElement.scrollWidth") <= 390, place
    keep(phone, "phone")


def test_a_tap_on_the_empty_canvas_chooses_a_picture(phone: Page) -> None:
    go(phone, "#/new")
    with phone.expect_file_chooser():
        phone.get_by_role("button", name="Choose a picture").tap()


PASTE = """async (text) => {
  const moved = new DataTransfer();
  if (text) moved.setData("text/plain", text);
  else {
    const sheet = document.createElement("canvas");
    const blob = await new Promise((resolve) => sheet.toBlob(resolve, "image/png"));
    moved.items.add(new File([blob], "tea-pot.png", { type: "image/png" }));
  }
  const told = { clipboardData: moved, bubbles: true, cancelable: true };
  document.body.dispatchEvent(new ClipboardEvent("paste", told));
}"""


def test_a_pasted_picture_becomes_a_goal_and_a_draft_stays_until_it_is_dropped(desk: Page) -> None:
    go(desk, "#/new")
    expect(desk.get_by_role("button", name="Choose a picture")).to_be_visible()
    desk.evaluate(PASTE, "")
    expect(desk.get_by_label("Title")).to_have_value("tea pot")
    desk.get_by_label("Detailed").check()
    go(desk, "#/")
    desk.reload()
    go(desk, "#/new")
    expect(desk.get_by_label("Title")).to_have_value("tea pot")
    expect(desk.get_by_label("Detailed")).to_be_checked()
    expect(desk.locator(".terms li")).to_have_count(1)
    desk.get_by_role("button", name="Start over").click()
    expect(desk.get_by_role("button", name="Choose a picture")).to_be_visible()
    expect(desk.locator(".terms li")).to_have_count(0)


def test_pasted_text_is_a_goal_or_it_is_said_what_is_missing(desk: Page) -> None:
    go(desk, "#/")
    go(desk, "#/new")
    expect(desk.get_by_role("button", name="Choose a picture")).to_be_visible()
    desk.evaluate(PASTE, "a ship  at dusk")
    either = desk.get_by_label("What to paint").or_(desk.get_by_text("There is no picture in the clipboard"))
    expect(either).to_be_visible()
    if desk.get_by_role("button", name="Start over").is_visible():
        desk.get_by_role("button", name="Start over").click()


def test_focus_follows_to_a_new_view_and_a_new_step(desk: Page, studio: OpenStudio) -> None:
    painting = Told(studio, *PLANNED)
    go(desk, "#/")
    for place, heading in (
        ("#/new", "Set the goal"),
        ("#/calibrate", "Calibrate the easel"),
        ("#/", "What do you want to paint?"),
    ):
        go(desk, place)
        expect(desk.get_by_role("heading", name=heading)).to_be_focused()
    painting.show(desk)
    expect(desk.get_by_role("heading", name="Review the plan")).to_be_focused()
    desk.get_by_role("button", name="Use plan 1").press("Enter")
    expect(desk.get_by_role("heading", name="Prepare")).to_be_focused()


def test_the_plan_step_shows_the_goal_too(desk: Page, studio: OpenStudio) -> None:
    Told(studio, *PLANNED).show(desk)
    goal = desk.get_by_role("button", name="Goal", exact=True)
    goal.click()
    fade = desk.get_by_label("Fade between goal, plan")
    expect(fade).to_have_value("0")
    plan = desk.get_by_alt_text("The finished plan")
    assert plan.evaluate("image => getComputedStyle(image).opacity") == "0"
    fade.fill("0.5")
    assert plan.evaluate("image => getComputedStyle(image).opacity") == "0.5"
    expect(desk.get_by_role("list", name="The goal").get_by_text("Paint this picture")).to_be_visible()
    expect(desk.get_by_text("Painting it takes about")).to_be_visible()
    keep(desk, "plan")


def test_the_paint_step_fills_the_window_with_easel_robot_brush_and_wells(desk: Page, studio: OpenStudio) -> None:
    painting = Told(studio, *PLANNED, *PAINTED)
    with painting.at_work():
        painting.show(desk)
        expect(desk.get_by_alt_text("The canvas after 3 strokes")).to_be_visible()
        assert in_sight(desk, ".easel .mount:visible") and in_sight(desk, ".easel-state")
        box = desk.locator(".easel .mount:visible").bounding_box()
        assert box is not None and box["height"] >= 0.55 * 900
        expect(desk.locator(".easel-state")).to_contain_text("paint 2, 3 strokes since the dip")
        expect(desk.get_by_label("Paint 2: 1 dip", exact=True)).to_be_visible()
        painting.tell(PAUSED)
        expect(desk.locator(".easel-state")).to_contain_text("stands still, arm aside")
        expect(desk.locator(".easel-state")).to_contain_text("clean")
        keep(desk, "paint")


def test_after_protecting_a_part_it_says_what_that_changed(desk: Page, studio: OpenStudio) -> None:
    painting = Told(studio, *PLANNED, *PAINTED, PAUSED, *PROTECTED, PAUSED)
    with painting.at_work():
        painting.show(desk)
        said = desk.locator(".looks")
        expect(said).to_contain_text("It replanned the rest so that no stroke touches the protected part.")
        expect(said).to_contain_text("20 % farther from the goal than the old ones, because a part is left out")


def test_a_drawing_added_midway_is_part_of_the_goal_from_then_on(desk: Page, studio: OpenStudio) -> None:
    changed = [{"kind": "considering"}, {"kind": "goal_changed", "goal": "changes/1", "wish": CHANGED}]
    painting = Told(studio, *PLANNED, *PAINTED, PAUSED, *changed, PAUSED)
    goal = desk.get_by_role("list", name="The goal")
    with painting.at_work():
        painting.show(desk)
        expect(goal.get_by_alt_text("Drawing")).to_be_visible()
        expect(goal.get_by_text("weight: high")).to_be_visible()
        painting.tell(*FINISHED)
    expect(desk.get_by_text("40 strokes are on the canvas")).to_be_visible()
    expect(goal.get_by_alt_text("Drawing")).to_be_visible()


def test_the_film_opens_on_the_painting(desk: Page, studio: OpenStudio) -> None:
    painting = Told(studio, *PLANNED, *PAINTED, *FINISHED)
    painting.show(desk)
    expect(desk.locator("video")).to_have_attribute(
        "poster", re.compile(rf"/paintings/{painting.id}/painting/painting.png")
    )


@pytest.fixture
def paused(studio: OpenStudio) -> Iterator[Told]:
    painting = Told(studio, *PLANNED, *PAINTED, PAUSED)
    with painting.at_work():
        yield painting


def test_on_a_phone_the_drawing_pad_opens_where_it_is_seen(phone: Page, paused: Told) -> None:
    paused.show(phone)
    phone.get_by_role("button", name="Protect a part").tap()
    expect(phone.locator(".pad")).to_be_visible()
    assert in_sight(phone, ".pad") and in_sight(phone, ".tools")
    keep(phone, "phone-pad")
    phone.get_by_role("button", name="Cancel").tap()
    assert in_sight(phone, ".together button >> nth=0")


def marked(folder: PaintingFolder) -> Image.Image:
    """The region that was handed in last, light where it was drawn."""
    return Image.open(folder.region(1)).convert("L")


def test_a_part_is_protected_by_keyboard_alone(browser: Browser, studio: OpenStudio, paused: Told) -> None:
    paused.folder.region(1).unlink()
    with window(browser, studio, 1440, 900) as page:
        lead(page)
        paused.show(page)
        expect(page.get_by_role("button", name="Protect a part")).to_be_visible()
        page.keyboard.press("m")
        expect(page.locator(".pad canvas")).to_be_focused()
        expect(page.locator(".pad .cross")).to_be_visible()
        page.keyboard.press("Space")
        for _ in range(8):
            page.keyboard.press("Shift+ArrowLeft")
        page.keyboard.press("Space")
        expect(page.get_by_text("Pen up, 10 % from the left, 50 % from the top")).to_be_attached()
        keep(page, "keyboard-pad")
        page.get_by_role("button", name="Do not paint in this part").press("Enter")
        expect(page.locator(".pad")).to_be_hidden()
        assert focused(page) == "Continue"
    drawn = marked(paused.folder)
    width, height = drawn.size
    assert [drawn.getpixel((int(width * x), int(height * 0.5))) for x in (0.04, 0.15, 0.3, 0.45, 0.7)] == [
        0,
        255,
        255,
        255,
        0,
    ]
    assert drawn.getpixel((int(width * 0.3), int(height * 0.2))) == 0


def test_the_pad_undoes_redoes_and_zooms(desk: Page, paused: Told) -> None:
    paused.show(desk)
    desk.get_by_role("button", name="Protect a part").click()
    surface = desk.locator(".pad canvas")
    undo, redo = desk.get_by_role("button", name="Undo"), desk.get_by_role("button", name="Redo")
    expect(undo).to_be_disabled()
    stroke(desk, (0.2, 0.5), (0.4, 0.5))
    assert inked(desk, 0.3, 0.5) and not inked(desk, 0.3, 0.9)
    undo.click()
    assert not inked(desk, 0.3, 0.5)
    redo.click()
    assert inked(desk, 0.3, 0.5)
    expect(redo).to_be_disabled()
    surface.focus()
    desk.keyboard.press("Control+z")
    assert not inked(desk, 0.3, 0.5)
    desk.keyboard.press("Control+Shift+Z")
    assert inked(desk, 0.3, 0.5)
    desk.get_by_role("button", name="Clear").click()
    assert not inked(desk, 0.3, 0.5)
    desk.get_by_role("button", name="Zoom in").click()
    desk.get_by_role("button", name="Zoom in").click()
    expect(desk.get_by_role("button", name="Show the whole sheet")).to_have_text("225 %")
    stroke(desk, (0.5, 0.5), (0.9, 0.5))  # of the window: the sheet's middle, and 0.18 of it to the right
    assert inked(desk, 0.6, 0.5) and not inked(desk, 0.75, 0.5)
    keep(desk, "zoomed")
    desk.get_by_role("button", name="Cancel").click()


def stroke(page: Page, begin: tuple[float, float], end: tuple[float, float]) -> None:
    """A line with the mouse, in shares of the pad's window."""
    page.locator(".pad").scroll_into_view_if_needed()
    box = page.locator(".pad").bounding_box()
    assert box is not None
    places = [(box["x"] + x * box["width"], box["y"] + y * box["height"]) for x, y in (begin, end)]
    page.mouse.move(*places[0])
    page.mouse.down()
    page.mouse.move(*places[1], steps=5)
    page.mouse.up()


def inked(page: Page, x: float, y: float) -> bool:
    """Whether something is drawn at a place of the sheet, in shares of its sides."""
    script = """async (canvas, [x, y]) => {
      await new Promise((resolve) => requestAnimationFrame(() => requestAnimationFrame(resolve)));
      return canvas.getContext("2d").getImageData(x * canvas.width, y * canvas.height, 1, 1).data[3] > 0;
    }"""
    return bool(page.locator(".pad canvas").evaluate(script, [x, y]))


def test_shortcuts_are_listed_work_and_can_be_turned_off(desk: Page) -> None:
    go(desk, "#/")
    expect(desk.get_by_role("heading", name="What do you want to paint?")).to_be_visible()
    desk.keyboard.press("n")
    expect(desk.get_by_role("heading", name="Set the goal")).to_be_focused()
    desk.get_by_label("Title").fill("")
    desk.get_by_label("Title").press_sequentially("gnc?")
    expect(desk.get_by_label("Title")).to_have_value("gnc?")
    desk.get_by_role("button", name="Start over").click()
    expect(desk.get_by_role("heading", name="Set the goal")).to_be_visible()
    desk.get_by_role("heading", name="Set the goal").evaluate("heading => { heading.tabIndex = -1; heading.focus(); }")
    desk.keyboard.press("?")
    sheet = desk.get_by_role("heading", name="Keyboard shortcuts")
    expect(sheet).to_be_visible()
    expect(desk.get_by_role("button", name="Stop", exact=True)).to_be_visible()
    keep(desk, "shortcuts")
    desk.get_by_label("Use shortcuts of one letter").uncheck()
    desk.keyboard.press("Escape")
    expect(sheet).to_be_hidden()
    desk.locator("h1").focus()
    desk.keyboard.press("g")
    expect(desk.get_by_role("heading", name="Set the goal")).to_be_visible()
    desk.keyboard.press("?")
    desk.get_by_label("Use shortcuts of one letter").check()
    desk.keyboard.press("Escape")
    desk.locator("h1").focus()
    desk.keyboard.press("g")
    expect(desk.get_by_role("heading", name="What do you want to paint?")).to_be_visible()


def test_the_page_can_be_installed_and_says_when_the_studio_is_away(desk: Page) -> None:
    go(desk, "#/")
    active = desk.evaluate("navigator.serviceWorker.ready.then((registered) => registered.active.scriptURL)")
    assert active.endswith("/sw.js")
    desk.reload()  # from now on the worker serves the page
    desk.context.set_offline(True)
    try:
        desk.goto(desk.url)
        desk.reload()
        expect(desk.get_by_role("heading", name="The studio does not answer")).to_be_visible()
        expect(desk.get_by_text("use its own emergency stop")).to_be_visible()
    finally:
        desk.context.set_offline(False)
    desk.get_by_role("link", name="Try again").click()
    expect(desk.get_by_role("heading", name="What do you want to paint?")).to_be_visible()


SECRETLY = """() => {
  window.told = [];
  const state = { get: () => (window.away ? "hidden" : "visible"), configurable: true };
  Object.defineProperty(document, "visibilityState", state);
  document.hasFocus = () => !window.away;
  Object.defineProperty(Notification, "permission", { get: () => "granted", configurable: true });
  ServiceWorkerRegistration.prototype.showNotification = async (title, { body }) => { window.told.push(body); };
  window.away = true;
}"""


def test_somebody_who_looks_elsewhere_is_told_that_they_are_needed(browser: Browser, studio: OpenStudio) -> None:
    painting = Told(studio, *PLANNED, *PAINTED)
    with painting.at_work(), window(browser, studio, 1440, 900) as page:
        page.evaluate("navigator.serviceWorker.ready")
        page.evaluate(SECRETLY)
        painting.show(page)
        expect(page.get_by_role("heading", name="Paint together")).to_be_visible()
        assert page.title() == "Cup · The studio"
        painting.tell({**PAUSED, "turn": True})
        expect(page).to_have_title("● Cup · The studio")
        assert page.evaluate("window.told") == ["Cup: it is your turn to paint."]
        page.evaluate("() => { window.away = false; window.dispatchEvent(new Event('focus')); }")
        expect(page).to_have_title("Cup · The studio")


def test_what_is_done_elsewhere_can_be_seen_and_stopped_in_the_gallery(desk: Page, studio: OpenStudio) -> None:
    go(desk, "#/")
    stop = desk.get_by_role("button", name="Stop", exact=True)
    expect(stop).not_to_have_class(re.compile("live"))
    place = stop.bounding_box()
    painting = Told(studio, *PLANNED, *PAINTED)
    with painting.at_work():
        expect(stop).to_have_class(re.compile("live"))
        assert stop.bounding_box() == place  # it is always where one reaches for it
        expect(desk.get_by_text("being painted")).to_be_visible()
        keep(desk, "gallery")
    expect(stop).not_to_have_class(re.compile("live"))


def test_a_painting_is_put_into_the_queue_and_taken_out(browser: Browser, studio: OpenStudio) -> None:
    painting = Told(studio, *PLANNED)
    with window(browser, studio, 1440, 900) as page, painting.at_work():  # so that the queue does not begin it
        lead(page)
        painting.show(page)
        page.get_by_role("button", name="Use plan 1").click()
        page.get_by_role("button", name="Paint it after the others").click()
        expect(page.get_by_text("It waits in the queue, and is painted when")).to_be_visible()
        keep(page, "queued")
        go(page, "#/")
        queue = page.get_by_role("region", name="Queue")
        expect(queue.get_by_role("listitem")).to_contain_text("to be painted")
        keep(page, "queue")
        queue.get_by_role("button", name="Remove").click()
        expect(queue).to_be_hidden()
        painting.show(page)
        expect(page.get_by_role("button", name="Use plan 1")).to_be_visible()


def test_the_picture_of_a_real_camera_is_shown_as_long_as_it_has_one(browser: Browser, studio: OpenStudio) -> None:
    painting = Told(studio, *PLANNED, *PAINTED)
    Image.new("RGB", (64, 48), (200, 30, 30)).save(painting.folder.camera)
    with painting.at_work(), window(browser, studio, 1440, 900) as page:

        def with_camera(route: Route) -> None:
            answer = route.fetch()
            route.fulfill(response=answer, json={**answer.json(), "camera": True})

        page.route("**/api/studio", with_camera)
        page.reload()
        painting.show(page)
        live = page.get_by_alt_text("What the camera sees now")
        expect(live).to_be_visible()
        keep(page, "camera")
        painting.folder.camera.unlink()
        expect(live).to_be_hidden()
        page.unroute_all(behavior="wait")


def test_a_drawing_is_made_by_keyboard_alone(browser: Browser, studio: OpenStudio) -> None:
    def with_networks(route: Route) -> None:
        answer = route.fetch()
        told = answer.json()
        told["abilities"]["sketch"]["ready"] = True
        route.fulfill(response=answer, json=told)

    with window(browser, studio, 1440, 900) as page:
        page.route("**/api/studio", with_networks)
        page.reload()
        go(page, "#/new")
        page.get_by_role("button", name="+ Drawing").press("Enter")
        expect(page.locator(".pad canvas")).to_be_focused()
        page.keyboard.press("Enter")
        for key in ("ArrowRight", "ArrowDown", "ArrowLeft"):
            for _ in range(3):
                page.keyboard.press(f"Shift+{key}")
        page.keyboard.press("Enter")
        page.get_by_role("button", name="Use this drawing").press("Enter")
        expect(page.get_by_alt_text("Drawing", exact=True)).to_be_visible()
        assert focused(page) == "+ Drawing"
        expect(page.get_by_role("button", name="Make a plan")).to_be_enabled()
        keep(page, "drawn")
        page.unroute_all(behavior="wait")
