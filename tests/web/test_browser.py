"""The whole story in a real browser, on the virtual studio; skipped where there is no Chromium."""

import contextlib
import re
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Browser, Locator, Page, TimeoutError, expect

from browsing import PATIENCE, SCREENSHOTS, WITH_CHROMIUM, OpenStudio, chromium, deadline, opened_studio, window
from downloads import fetched
from frida_painter import images
from support.planning import picture

pytestmark = [pytest.mark.slow, WITH_CHROMIUM]


@pytest.fixture(scope="module")
def studio(tmp_path_factory: pytest.TempPathFactory) -> Iterator[OpenStudio]:
    with opened_studio(tmp_path_factory.mktemp("studio") / "paintings") as opened:
        yield opened


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    with deadline(), chromium() as opened:
        yield opened


@pytest.fixture
def page(browser: Browser, studio: OpenStudio) -> Iterator[Page]:
    """A window on the studio."""
    with window(browser, studio, 1280, 860) as opened:
        yield opened


@pytest.fixture(scope="module")
def photograph(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("photograph") / "disc_and_bar.png"
    images.save(picture(90, 120), path)
    return path


def keep(page: Page, name: str) -> None:
    """A screenshot for people."""
    page.screenshot(path=SCREENSHOTS / f"{name}.png")


def say(page: Page, photograph: Path, strokes: int = 15) -> None:
    """Asks for a small painting of the photograph."""
    page.get_by_role("link", name="New painting").click()
    page.set_input_files("input[type=file]", photograph)
    page.get_by_label("Quick study").check()
    page.get_by_text("More settings").click()
    slide(page, "Strokes", 0)
    slide(page, "Paints to mix", 3)
    slide(page, "Replans", 1)
    page.get_by_role("button", name="Make a plan").click()


def slide(page: Page, label: str, value: int) -> None:
    page.get_by_label(label).fill(str(value))


def start(page: Page, plan: int = 1) -> None:
    page.get_by_role("button", name=f"Use plan {plan}").click()
    begin = page.get_by_role("button", name="Start painting")
    expect(begin).to_be_disabled()
    for box in page.locator(".check input").all():
        box.check()
    begin.click(timeout=PATIENCE)  # enabled once the planner's process has ended
    expect(page.get_by_role("heading", name="Paint together")).to_be_visible(timeout=PATIENCE)


def test_a_painting_from_the_wish_to_the_gallery(page: Page, studio: OpenStudio, photograph: Path) -> None:
    say(page, photograph)
    expect(page.get_by_role("button", name="Use plan 1")).to_be_visible(timeout=PATIENCE)  # it is planned to the end
    assert page.locator(".palette li").count() in (2, 3), "one each for disc and bar; a third if it paints something"
    scrub = page.get_by_label("Strokes painted so far")
    scrub.fill("7")
    expect(page.get_by_text("7 of 15")).to_be_visible()
    expect(page.locator(".overlay .mark")).to_have_count(1, timeout=PATIENCE)
    keep(page, "plan")
    start(page)
    expect(page.locator(".status")).to_have_text(re.compile(r"Stroke \d+ of 15"), timeout=PATIENCE)
    page.reload()
    expect(page.get_by_role("heading", name="Paint together")).to_be_visible(timeout=PATIENCE)
    place = page.url.partition("#")[2]
    studio.fall_over_and_be_started_again()  # the painting goes on
    page.goto(studio.address)
    expect(page.get_by_text("What do you want to paint?")).to_be_visible(timeout=PATIENCE)
    page.evaluate("place => { location.hash = place; }", place)
    expect(page.locator(".looks h3").first).to_be_visible(timeout=PATIENCE)
    expect(page.get_by_role("link", name="The painting", exact=True)).to_be_visible(timeout=PATIENCE)
    keep(page, "finished")
    film = page.locator("video")
    film.evaluate("async film => { film.muted = true; await film.play(); }")
    assert film.evaluate("film => film.videoWidth") > 0
    with page.expect_download() as taken:
        page.get_by_role("link", name="Everything").click()
    assert taken.value.path().stat().st_size > 10_000
    page.get_by_role("link", name="Gallery").click()
    expect(page.get_by_role("link", name="disc and bar")).to_be_visible()
    page.get_by_role("link", name="disc and bar").click()
    page.on("dialog", lambda dialog: dialog.accept())
    page.get_by_role("button", name="Delete").click()
    expect(page.get_by_text("What do you want to paint?")).to_be_visible()
    expect(page.locator(".shelf a")).to_have_count(0)


BEGIN = """async (wish) => {
  const api = await import("/static/api.js");
  await api.post("/api/lead");  // the page of another test may have led, and not given it back yet
  const sheet = document.createElement("canvas");
  [sheet.width, sheet.height] = [120, 90];
  const paper = sheet.getContext("2d");
  paper.fillStyle = "#eadfcb"; paper.fillRect(0, 0, 120, 90);
  paper.fillStyle = "#b23a20"; paper.fillRect(30, 20, 60, 50);
  const picture = await api.upload(await new Promise((resolve) => sheet.toBlob(resolve)));
  const begun = await api.post("/api/paintings", { terms: [{ kind: "image", picture }], ...wish });
  location.hash = `#/p/${begun.id}`;
  return { id: begun.id, picture };
}"""
AGAIN = """async ({ id, picture, wish }) => {
  const api = await import("/static/api.js");
  await api.post(`/api/paintings/${id}/plans`, { terms: [{ kind: "image", picture }], ...wish });
}"""


def test_stopped_while_planning_and_in_a_stroke_with_two_browsers_one_of_them_a_tablet(
    page: Page, browser: Browser, studio: OpenStudio
) -> None:
    begun = page.evaluate(BEGIN, {"title": "Red", "strokes": 300, "effort": 2, "colors": 2})
    expect(page.get_by_label("Planning")).to_be_visible()
    page.get_by_role("button", name="Stop", exact=True).click()
    expect(page.get_by_role("heading", name="You stopped the planning")).to_be_visible(timeout=PATIENCE)
    expect(page.get_by_role("button", name="Plan again")).to_be_enabled(timeout=PATIENCE)
    page.evaluate(AGAIN, {**begun, "wish": {"strokes": 10, "effort": 0.05, "colors": 2, "replans": 1}})
    expect(page.get_by_role("button", name="Use plan 2")).to_be_visible(timeout=PATIENCE)
    with window(browser, studio, 820, 1180) as tablet:
        tablet.evaluate("id => { location.hash = `#/p/${id}`; }", begun["id"])
        expect(tablet.get_by_role("button", name="Use plan 2")).to_be_visible()
        assert tablet.evaluate("document.documentElement.scrollWidth") <= 820
        start(page, 2)
        pause = tablet.get_by_role("button", name="Pause after this stroke")
        pause.click(timeout=3 * PATIENCE)  # the easel opens as fast as the machine has time
        tablet.get_by_role("button", name="Take control and continue").click()
        expect(page.get_by_role("button", name="Continue", exact=True)).to_be_visible(timeout=PATIENCE)
        protect(tablet)
        for each in (page, tablet):
            expect(each.locator(".hatching").first).to_be_visible(timeout=PATIENCE)
        keep(page, "protected")
        keep(tablet, "protected-tablet")
        expect(tablet.get_by_role("button", name="Continue", exact=True)).to_be_visible(timeout=PATIENCE)
        tablet.get_by_role("button", name="Continue", exact=True).click()
        expect(page.get_by_role("button", name="Pause after this stroke")).to_be_visible(timeout=PATIENCE)
        page.keyboard.press("Escape")
        page.keyboard.press("Escape")
        for each in (page, tablet):
            expect(each.get_by_text("You stopped after")).to_be_visible(timeout=PATIENCE)
        keep(page, "stopped")
        go_on = tablet.get_by_role("button", name="Continue this painting")
        go_on.click()  # a simulated robot needs nobody who has looked
        expect(page.get_by_role("heading", name="Paint together")).to_be_visible(timeout=PATIENCE)
        deadline = time.monotonic() + 150
        while page.get_by_text("are on the canvas").count() == 0 and time.monotonic() < deadline:
            asked = tablet.locator(".question").get_by_role("button", name="No", exact=True)
            if asked.count():
                with contextlib.suppress(TimeoutError):  # the page was just drawn anew: it asks again
                    asked.click(timeout=2000)
            tablet.wait_for_timeout(100)
        expect(page.get_by_text("10 strokes are on the canvas")).to_be_visible()


def test_the_page_tells_which_words_a_plan_shows(page: Page) -> None:
    fetched("minilm")
    words = {"kind": "text", "words": "a calm sea at dawn with a zeugma"}
    page.evaluate(BEGIN, {"title": "Sea", "strokes": 6, "effort": 0.05, "colors": 2, "terms": [words]})
    expect(page.get_by_role("button", name="Use plan 1")).to_be_visible(timeout=3 * PATIENCE)
    told = page.get_by_text("Your words: shown:")
    expect(told).to_be_visible()
    expect(told).to_contain_text(re.compile("not shown: .*'zeugma'"))
    keep(page, "words-of-a-plan")


def protect(page: Page) -> None:
    """Draws over the left of the canvas, which the robot must not touch then."""
    page.get_by_role("button", name="Protect a part").click()
    box = page.locator(".pad canvas").bounding_box()
    assert box is not None
    page.mouse.move(box["x"] + 0.1 * box["width"], box["y"] + 0.2 * box["height"])
    page.mouse.down()
    page.mouse.move(box["x"] + 0.1 * box["width"], box["y"] + 0.8 * box["height"], steps=4)
    page.mouse.up()
    page.get_by_role("button", name="Do not paint in this part").click()


CALIBRATE = """async () => {
  const api = await import("/static/api.js");
  await api.post("/api/lead");  // the page of another test may have led, and not given it back yet
  await api.post("/api/calibration/start", { what: ["canvas", "brush"], brush: "fine", width: 160, height: 120 });
}"""


def test_corners_are_dragged_and_the_brush_is_lowered_with_a_jog_key(page: Page) -> None:
    page.get_by_role("link", name="Calibrate").click()
    expect(page.get_by_role("button", name="Run: Canvas position")).to_be_enabled()
    page.evaluate(CALIBRATE)  # two at once, which load what they need but once
    corner = page.get_by_label("The top left corner")
    expect(corner).to_be_visible(timeout=PATIENCE)
    found = place(corner)
    drag(page, corner, (30, 20), (2, 0))
    expect(corner).not_to_have_attribute("aria-valuetext", described(found))
    dragged = place(corner)
    assert dragged[0] > found[0] and abs(dragged[1] - found[1]) <= 1
    corner.press("ArrowLeft")
    expect(corner).to_have_attribute("aria-valuetext", described((dragged[0] - 1, dragged[1])))
    page.get_by_role("button", name="These are the corners").click()
    page.get_by_role("button", name="Save the length").click(timeout=PATIENCE)
    page.get_by_role("button", name="No", exact=True).click(timeout=PATIENCE)  # not by looking
    height = page.locator(".jog strong")
    expect(height).to_be_visible(timeout=PATIENCE)
    before = float(height.inner_text().removesuffix(" mm"))
    page.keyboard.press("ArrowDown")
    expect(height).to_have_text(f"{before - 1:.1f} mm")
    page.get_by_label("Up by 0.2 mm").click()
    expect(height).to_have_text(f"{before - 0.8:.1f} mm")
    keep(page, "jog")
    page.get_by_role("button", name="The height is right").click()
    expect(page.get_by_text("the bristles are spread")).to_be_visible(timeout=PATIENCE)
    page.get_by_label("Down by 5 mm").click()
    expect(height).to_have_text(f"{before - 5.8:.1f} mm")
    page.get_by_role("button", name="The height is right").click()
    expect(page.locator(".procedures .done")).to_have_count(2, timeout=PATIENCE)
    keep(page, "calibrated")


def drag(page: Page, corner: Locator, over: tuple[int, int], to: tuple[int, int]) -> None:
    """Takes hold of a handle and leaves it `to` pixels of the page away, by way of a place that is `over` away."""
    photograph = page.locator(".mount.photograph img")
    expect(photograph).to_have_js_property("complete", True)
    corner.hover()  # which waits until it stands still, lies in the window, and nothing lies over it
    box = corner.bounding_box()
    assert box is not None
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    page.mouse.move(x, y)
    page.mouse.down()
    expect(page.locator(".loupe")).to_be_visible()  # it is held
    page.mouse.move(x + over[0], y + over[1], steps=2)
    keep(page, "corner-dragged")
    page.mouse.move(x + to[0], y + to[1], steps=2)
    page.mouse.up()
    expect(page.locator(".loupe")).to_be_hidden()  # and let go: every motion before was heard


def described(place: tuple[int, int]) -> str:
    """What a handle that stands there tells of itself."""
    return f"column {place[0]}, row {place[1]}"


def place(corner: Locator) -> tuple[int, int]:
    """Where a handle stands, in pixels of the photograph."""
    column, row = re.findall(r"\d+", corner.get_attribute("aria-valuetext") or "")
    return int(column), int(row)
