"""The page as people use it: with a mouse, on a phone, by keyboard alone; on paintings of which it is told here."""

import re
import shutil
import sys
import time
from collections.abc import Iterator
from typing import Any

import pytest
from PIL import Image
from playwright.sync_api import Browser, Page, Route, expect

from browsing import SCREENSHOTS, WITH_CHROMIUM, OpenStudio, chromium, complaints, deadline, opened_studio, window
from frida_painter.web.commands import CommandReader, Pause, Protect
from frida_painter.web.studio_folder import PaintingFolder
from support.told import CHANGED, FINISHED, PAINTED, PAUSED, PICTURES, PLANNED, PROTECTED, REQUEST, Told

pytestmark = [pytest.mark.slow, WITH_CHROMIUM]

PAINTER = """
import sys
from PIL import Image, ImageDraw
seed = int(sys.argv[2])
picture = Image.new("RGB", (96, 72), (120, 170 - 20 * (seed % 6), 220))
ImageDraw.Draw(picture).rectangle((12 + 10 * (seed % 6), 20, 24 + 10 * (seed % 6), 64), fill=(200, 40, 30))
picture.save(sys.argv[3])
"""
PHONE: dict[str, Any] = {"has_touch": True, "is_mobile": True}


@pytest.fixture(scope="module")
def studio(tmp_path_factory: pytest.TempPathFactory) -> Iterator[OpenStudio]:
    folder = tmp_path_factory.mktemp("studio")
    (folder / "painter.py").write_text(PAINTER)
    maker = f"command:{sys.executable} {folder / 'painter.py'} {{words}} {{seed}} {{out}}"
    with opened_studio(folder / "paintings", "--imagine", maker) as opened:
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


def test_on_a_phone_the_main_action_is_in_reach_and_lies_over_nothing_for_good(phone: Page, studio: OpenStudio) -> None:
    planned, painted = Told(studio, *PLANNED), Told(studio, *PLANNED, *PAINTED)
    with painted.at_work():
        for place, name in (
            ("#/new", "Make a plan"),
            (planned.id, "Use plan 1"),
            (painted.id, "Pause after this stroke"),
        ):
            go(phone, place if place.startswith("#") else f"#/p/{place}")
            expect(phone.get_by_role("button", name=name)).to_be_visible()
            assert in_sight(phone, ".main-action .button"), "without any scrolling"
            phone.evaluate("scrollTo(0, document.documentElement.scrollHeight)")
            assert in_sight(phone, ".main-action .button")
            below = """() => {
              const bar = document.querySelector(".main-action");
              const others = [...document.querySelectorAll("#view :is(a, button, input, summary, p)")];
              const shown = others.filter((each) => !bar.contains(each) && each.checkVisibility());
              const lowest = Math.max(...shown.map((each) => each.getBoundingClientRect().bottom));
              return lowest <= bar.getBoundingClientRect().top;
            }"""
            assert phone.evaluate(below), f"{name}: the end of the page is free"
            middle = "document.elementFromPoint(340, document.querySelector('.bar').offsetHeight / 2).id"
            assert phone.evaluate(middle) == "stop"


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


def test_an_empty_gallery_shows_examples_and_one_of_them_becomes_the_goal(phone: Page) -> None:
    phone.route("**/api/paintings", lambda route: route.fulfill(json=[]))
    go(phone, "/calibrate")
    go(phone, "/")
    phone.get_by_role("button", name="Paint this one: Chelsea the cat").click()
    expect(phone.get_by_label("Title")).to_have_value("Chelsea the cat")
    expect(phone.get_by_alt_text("The picture to paint")).to_have_js_property("naturalWidth", 451)
    picture = phone.get_by_role("application", name="The picture on the canvas")
    picture.press("+")
    picture.press("ArrowLeft")
    expect(phone.get_by_text("125 %")).to_be_visible()
    with phone.expect_request("**/api/paintings") as asked:
        phone.get_by_role("button", name="Make a plan").click()  # (the route above answers it)
    left, top, width, height = asked.value.post_data_json["terms"][0]["crop"]
    assert top > 0 and left < (1 - width) / 2 and width == pytest.approx(0.8, abs=1e-3) == height
    keep(phone, "example-taken")
    phone.wait_for_url("**/#/p/undefined")
    go(phone, "/")
    phone.unroute("**/api/paintings")


def test_pasted_text_is_a_goal_and_a_picture_made_from_it_can_take_its_place(desk: Page) -> None:
    go(desk, "#/")
    go(desk, "#/new")
    expect(desk.get_by_role("button", name="Choose a picture")).to_be_visible()
    desk.evaluate(PASTE, "a ship  at dusk")
    expect(desk.get_by_label("What to paint")).to_have_value("a ship at dusk")
    desk.get_by_role("button", name="Make pictures from this text").press("Enter")
    expect(desk.get_by_role("button", name="Stop making pictures")).to_be_focused()
    made = desk.get_by_role("list", name="Pictures of a ship at dusk").get_by_role("button")
    expect(made).to_have_count(4)
    expect(desk.get_by_role("button", name="Make others, with another seed")).to_be_focused()
    expect(desk.get_by_text(re.compile("Made by command: .*painter.py"))).to_be_visible()
    desk.evaluate("Promise.all([...document.images].map((image) => image.decode().catch(() => {})))")
    desk.locator(".candidates").scroll_into_view_if_needed()
    assert complaints(desk) == []
    keep(desk, "made-pictures")
    desk.get_by_role("button", name="Begin with picture 3 of 4, seed 2").press("Enter")
    expect(desk.get_by_role("button", name="Remove: Picture")).to_be_focused()
    expect(desk.get_by_text(re.compile("Made from “a ship at dusk” by command.*seed 2"))).to_be_visible()
    expect(desk.get_by_label("Title")).to_have_value("a ship at dusk")
    expect(desk.get_by_role("button", name="Make a plan")).to_be_enabled()
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
    requested, made = PLANNED
    Told(studio, requested, {**made, "remarks": ["Not shown: 'a kite'."]}).show(desk)
    expect(desk.get_by_text("Not shown: 'a kite'.")).to_be_visible()
    goal = desk.get_by_role("button", name="Goal", exact=True)
    goal.click()
    fade = desk.get_by_label("Fade between goal, plan")
    expect(fade).to_have_value("0")
    plan = desk.get_by_alt_text("The finished plan")
    assert plan.evaluate("image => getComputedStyle(image).opacity") == "0"
    fade.fill("0.5")
    assert plan.evaluate("image => getComputedStyle(image).opacity") == "0.5"
    expect(desk.get_by_role("list", name="The goal").get_by_text("Paint this picture")).to_be_visible()
    expect(desk.get_by_text("Painting it takes")).to_be_visible()
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


def test_a_finished_painting_leaves_a_card_and_a_line_between_before_and_after(desk: Page, studio: OpenStudio) -> None:
    told = Told(studio, *PLANNED, *PAINTED, *FINISHED)
    told.show(desk)
    line = desk.get_by_role("slider", name="Before and after")
    line.press("ArrowLeft")
    expect(line).to_have_attribute("aria-valuetext", "49 % goal, 51 % painting")
    with desk.expect_download() as saved:
        desk.get_by_role("button", name="Save the card").click()
    assert saved.value.suggested_filename == "Cup-card.png"
    card = Image.open(saved.value.path())
    assert card.width == 1500 and card.getpixel((750, 400)) == (250, 0, 250, 255), "the painting itself"
    expect(desk.locator(".card-facts")).to_have_text(re.compile(r"^40 strokes, 2 paints · .*20\d\d"))
    desk.emulate_media(media="print")
    for hidden in (".bar", ".panel", ".compare"):
        expect(desk.locator(hidden)).to_be_hidden()
    expect(desk.locator(".card")).to_be_visible()
    desk.emulate_media(media="screen")


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
    handed_in = [each for each in CommandReader(folder, 0.0).listen() if isinstance(each, Protect)]
    return Image.open(folder.pictures / f"{handed_in[-1].picture}.png").convert("L")


def test_a_part_is_protected_by_keyboard_alone(browser: Browser, studio: OpenStudio, paused: Told) -> None:
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
    stroke(desk, (0.3, 0.3), (0.7, 0.3), (0.7, 0.7), (0.3, 0.7), (0.3, 0.32))
    assert not inked(desk, 0.5, 0.5)
    keep(desk, "lasso")
    desk.get_by_role("button", name="Mark the inside too").click()
    assert inked(desk, 0.5, 0.5) and not inked(desk, 0.1, 0.1)
    expect(surface).to_be_focused()
    undo.click()
    assert not inked(desk, 0.5, 0.5) and inked(desk, 0.3, 0.5)
    desk.get_by_role("button", name="Clear").click()
    surface.hover()
    surface.focus()
    desk.mouse.wheel(0, -200)
    expect(desk.get_by_role("button", name="Show the whole sheet")).to_have_text("140 %")
    surface.press("0")
    desk.get_by_role("button", name="Zoom in").click()
    desk.get_by_role("button", name="Zoom in").click()
    expect(desk.get_by_role("button", name="Show the whole sheet")).to_have_text("225 %")
    stroke(desk, (0.5, 0.5), (0.9, 0.5))  # of the window: the sheet's middle, and 0.18 of it to the right
    assert inked(desk, 0.6, 0.5) and not inked(desk, 0.75, 0.5)
    keep(desk, "zoomed")
    desk.get_by_role("button", name="Cancel").click()


def stroke(page: Page, *through: tuple[float, float]) -> None:
    """A line through these places with the mouse, in shares of the pad's window."""
    page.locator(".pad").scroll_into_view_if_needed()
    box = page.locator(".pad").bounding_box()
    assert box is not None
    places = [(box["x"] + x * box["width"], box["y"] + y * box["height"]) for x, y in through]
    page.mouse.move(*places[0])
    page.mouse.down()
    for place in places[1:]:
        page.mouse.move(*place, steps=5)
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
        painting.tell({**PAUSED, "cause": "turn"})
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


STOPPED_PLAN: list[dict[str, Any]] = [
    {"kind": "plan_requested", "plan": 1, "wish": REQUEST},
    {"kind": "planning_progress", "plan": 1, "share": 0.3, "left": 20.0},
    {"kind": "stopped"},
]


def stage_in_gallery(page: Page, painting: Told) -> str:
    go(page, "#/")
    card = page.locator(f".shelf a[href='#/p/{painting.id}']")
    expect(card).to_be_visible()
    return card.inner_text()


def test_a_painter_that_was_killed_is_told_as_such_and_continued(desk: Page, phone: Page, studio: OpenStudio) -> None:
    painting = Told(studio, *PLANNED, *PAINTED, {"kind": "time_left", "seconds": 20.0})
    (painting.folder.painting / "journal").write_text("")
    with painting.at_work():
        for page in (desk, phone):
            painting.show(page)
            expect(page.get_by_role("button", name="Pause after this stroke")).to_be_visible()
            expect(page.get_by_text("about 20 s left")).to_be_visible()
    for page in (desk, phone):
        for again in (False, True):
            if again:
                page.reload()
            expect(page.get_by_text("The painter's process ended in the middle of its work")).to_be_visible()
            expect(page.get_by_role("button", name="Continue this painting")).to_be_enabled()
            expect(page.get_by_role("button", name="Pause after this stroke")).to_have_count(0)
            expect(page.get_by_text("s left")).to_have_count(0)
        keep(page, f"killed-{'desk' if page is desk else 'phone'}")
    assert "failed" in stage_in_gallery(desk, painting)


def test_a_stopped_plan_is_no_finished_one(desk: Page, phone: Page, studio: OpenStudio) -> None:
    painting = Told(studio, *STOPPED_PLAN)
    for page in (desk, phone):
        painting.show(page)
        expect(page.get_by_role("heading", name="You stopped the planning")).to_be_visible()
        expect(page.get_by_role("button", name="Plan again")).to_be_enabled()
        expect(page.get_by_text("This is what the robot will paint")).to_have_count(0)
        keep(page, f"plan-stopped-{'desk' if page is desk else 'phone'}")
    assert "planning stopped" in stage_in_gallery(desk, painting)


def test_a_painting_whose_folder_was_deleted_is_told_as_such(desk: Page, phone: Page, studio: OpenStudio) -> None:
    painting = Told(studio, *PLANNED, *PAINTED)
    with painting.at_work():
        for page in (desk, phone):
            painting.show(page)
            expect(page.get_by_alt_text("The canvas after 3 strokes")).to_be_visible()
        shutil.rmtree(painting.folder.path)
        for page in (desk, phone):
            expect(page.get_by_text("Its painter still works")).to_be_visible()
            expect(page.locator("#stop")).to_have_class(re.compile("live"))
            keep(page, f"lost-{'desk' if page is desk else 'phone'}")
        assert "but it is being painted" in stage_in_gallery(desk, painting)
        painting.show(desk)
    expect(desk.get_by_text("Nothing of it is left")).to_be_visible()
    desk.once("dialog", lambda dialog: dialog.accept())
    lead(desk)
    desk.get_by_role("button", name="Remove it from the gallery").click()
    expect(desk.get_by_text("What do you want to paint?")).to_be_visible()
    expect(desk.locator(f".shelf a[href='#/p/{painting.id}']")).to_have_count(0)


def test_planning_waits_for_a_drawing_that_is_still_on_its_way(desk: Page, studio: OpenStudio) -> None:
    painting = Told(studio, *PLANNED)
    asked: list[dict[str, Any]] = []
    uploads: list[Route] = []

    def begin(route: Route) -> None:
        if route.request.method != "POST":
            route.continue_()
            return
        asked.append(route.request.post_data_json)
        route.fulfill(json={"id": painting.id})

    desk.route("**/api/paintings", begin)
    desk.route("**/api/pictures", lambda route: uploads.append(route))  # it does not end until we say so
    try:
        go(desk, "#/")
        go(desk, "#/new")
        desk.get_by_role("button", name="+ Drawing").click()
        sheet = desk.locator(".pad canvas").bounding_box()
        assert sheet is not None
        desk.mouse.move(sheet["x"] + 50, sheet["y"] + 50)
        desk.mouse.down()
        desk.mouse.move(sheet["x"] + 200, sheet["y"] + 120, steps=4)
        desk.mouse.up()
        desk.get_by_role("button", name="Use this drawing").click()
        expect(desk.get_by_text("The picture is on its way to the studio.")).to_be_visible()
        desk.get_by_role("button", name="Make a plan").click()
        expect(desk.get_by_role("button", name="Taking in the picture …")).to_be_disabled()
        keep(desk, "plan-waits")
        assert asked == [] and len(uploads) == 1
        uploads[0].abort()
        expect(desk.get_by_text("The studio does not answer")).to_be_visible()
        expect(desk.locator(".pad canvas")).to_be_visible()  # nothing is lost
        desk.get_by_role("button", name="Use this drawing").click()
        expect(desk.get_by_text("The picture is on its way to the studio.")).to_be_visible()
        desk.get_by_role("button", name="Make a plan").click()
        assert asked == [] and len(uploads) == 2
        uploads[1].fulfill(json={"id": "b" * 32})
        expect(desk.get_by_role("heading", name="Review the plan")).to_be_visible()
    finally:
        desk.unroute("**/api/paintings")
        desk.unroute("**/api/pictures")
    assert [term["picture"] for term in asked[0]["terms"]] == ["b" * 32]
    assert asked[0]["terms"][0]["kind"] == "sketch" and len(asked) == 1


def hidden_from(page: Page) -> set[str]:
    """What of these a role does not see."""
    names = ["Use plan 1", "Make another plan", "Plan with these changes", "New painting", "Calibrate", "Stop"]
    return {
        name
        for name in names
        if not page.get_by_role("button", name=name).or_(page.get_by_role("link", name=name)).first.is_visible()
    }


@pytest.mark.parametrize("size", [(1440, 900), (390, 844)])
@pytest.mark.parametrize("role", ["watch", "plan", "operate"])
def test_a_role_sees_what_it_is_and_no_form_that_it_may_not_use(
    browser: Browser, studio: OpenStudio, role: str, size: tuple[int, int]
) -> None:
    plan = {"Make another plan", "Plan with these changes", "New painting"}
    hidden = {"watch": plan | {"Use plan 1", "Calibrate"}, "plan": {"Use plan 1", "Calibrate"}, "operate": set[str]()}
    painting, stopped = Told(studio, *PLANNED), Told(studio, *PLANNED, *PAINTED, {"kind": "stopped", "done": 3})
    (stopped.folder.painting / "journal").write_text("")
    context = browser.new_context(viewport={"width": size[0], "height": size[1]})
    context.route("**/api/studio", lambda route: route.fulfill(json={**route.fetch().json(), "role": role}))
    page = context.new_page()
    page.goto(studio.address)
    page.wait_for_url("**/#/")
    name = f"{role}-{size[0]}"
    expect(page.get_by_text("What do you want to paint?")).to_be_visible()
    expect(page.locator("#role")).to_have_text({"watch": "You watch", "plan": "You plan", "operate": ""}[role])
    expect(page.get_by_role("link", name="Start a painting")).to_have_count(0 if role == "watch" else 1)
    keep(page, f"role-gallery-{name}")
    painting.show(page)
    expect(page.get_by_role("heading", name="Review the plan")).to_be_visible()
    if role != "watch":
        page.get_by_text("Change the goal").click()
    assert hidden_from(page) == hidden[role]
    assert page.evaluate("document.documentElement.scrollWidth") <= size[0]
    keep(page, f"role-plan-{name}")
    stopped.show(page)
    expect(page.get_by_text("You stopped after 3 strokes")).to_be_visible()
    expect(page.get_by_role("button", name="Continue this painting")).to_have_count(1 if role == "operate" else 0)
    keep(page, f"role-stopped-{name}")
    context.close()


def test_control_is_taken_and_the_order_done_with_one_button(browser: Browser, studio: OpenStudio) -> None:
    painting = Told(studio, *PLANNED, *PAINTED)
    with (
        painting.at_work(),
        window(browser, studio, 390, 844, **PHONE) as page,
        window(browser, studio, 800, 600) as two,
    ):
        for each in (page, two):
            painting.show(each)
            expect(each.get_by_role("button", name="Pause after this stroke")).to_be_visible()
        lead(two)
        page.get_by_role("button", name="Pause after this stroke").tap()
        take = page.get_by_role("button", name="Take control and continue")
        expect(take).to_be_visible()
        overlap = """() => {
            const [words, button] = ["#notice p", "#notice button"].map(
                (each) => document.querySelector(each).getBoundingClientRect());
            return button.top < words.bottom && button.left < words.right;
        }"""
        assert not page.evaluate(overlap), "the button lies over the words"
        keep(page, "take-control")
        take.tap()
        expect(page.locator("#notice")).to_be_empty()
        expect(page.get_by_role("button", name="It will pause after this stroke")).to_be_visible()
        heard, said = CommandReader(painting.folder, 0.0), list[Pause]()
        patience = time.monotonic() + 60
        while not said and time.monotonic() < patience:  # the page shows it before the server has heard it
            said += [each for each in heard.listen() if isinstance(each, Pause)]
            page.wait_for_timeout(50)
    assert len(said) == 1
