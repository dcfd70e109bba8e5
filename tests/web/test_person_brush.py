"""A person paints on the virtual canvas from the page, in a real browser; the painter is killed and resumed."""

import contextlib
import re
from collections.abc import Iterator

import pytest
from playwright.sync_api import Browser, Page, expect

from browsing import (
    BEGIN,
    PATIENCE,
    SCREENSHOTS,
    WITH_CHROMIUM,
    OpenStudio,
    chromium,
    complaints,
    deadline,
    drag,
    kill_worker,
    opened_studio,
    window,
)
from frida_painter.event_log import EventLog
from frida_painter.web.commands import ROBOT_MOVES

pytestmark = [pytest.mark.slow, WITH_CHROMIUM, pytest.mark.timeout(560)]  # on a busy machine

PAINT = """async (id) => {
  const api = await import("/static/api.js");
  const stroke = { kind: "paint", brush: "broad", paint: 0, points: [[0.5, 0.5, 0.5, 0, 0, 0]] };
  try { await api.post(`/api/paintings/${id}/say`, stroke); } catch (error) { return error.message; }
  return "";
}"""


@pytest.fixture(scope="module")
def studio(tmp_path_factory: pytest.TempPathFactory) -> Iterator[OpenStudio]:
    with opened_studio(tmp_path_factory.mktemp("studio") / "paintings") as opened:
        yield opened


@pytest.fixture(scope="module")
def page(studio: OpenStudio) -> Iterator[Page]:
    with deadline(), chromium() as browser, desk(browser, studio) as opened:
        yield opened


@contextlib.contextmanager
def desk(browser: Browser, studio: OpenStudio) -> Iterator[Page]:
    with window(browser, studio, 1280, 860) as opened:
        yield opened


def test_a_person_paints_between_the_robots_strokes_and_their_strokes_outlive_a_killed_painter(
    page: Page, studio: OpenStudio
) -> None:
    painting = page.evaluate(BEGIN)
    page.get_by_role("button", name="Use plan 1").click()
    for box in page.locator(".check input").all():
        box.check()
    page.get_by_role("button", name="Start painting").click()
    pause = page.get_by_role("button", name="Pause after this stroke")
    expect(pause).to_be_visible(timeout=3 * PATIENCE)
    assert page.evaluate(PAINT, painting) == ROBOT_MOVES
    pause.click()
    page.get_by_role("button", name="Paint on the canvas yourself").click()
    drag(page, (0.1, 0.2), (0.5, 0.4), (0.9, 0.2))
    expect(page.get_by_text("1 stroke of yours")).to_be_visible()
    page.locator(".person-brush").get_by_label("fine").check()
    page.get_by_role("button", name="Paint 2").click()
    pad = page.locator(".stroke-pad canvas")
    pad.focus()
    for key in (" ", "Shift+ArrowRight", "Shift+ArrowDown", " "):  # by keyboard
        pad.press(key)
    expect(page.get_by_text("2 strokes of yours")).to_be_visible()
    page.screenshot(path=SCREENSHOTS / "person-brush.png")
    (folder,) = studio.folder.glob(f"*-{painting[:6]}")
    kill_worker(folder)
    page.get_by_role("button", name="Continue this painting").click()
    expect(page.get_by_text("8 strokes are on the canvas")).to_be_visible(timeout=3 * PATIENCE)
    page.screenshot(path=SCREENSHOTS / "person-painted.png")
    diary = EventLog.read(folder / "painting/studio.diary")
    journal = EventLog.read(folder / "painting/journal")
    laid = [entry["stroke"] for entry in diary if entry.get("did") == "person"]
    assert laid == [entry["stroke"] for entry in journal if entry["kind"] == "person_stroke_began"]
    assert [(each["number"], each["brush"], each["paint"]) for each in laid][1] == (2, "fine", 1) and len(laid) == 2
    kinds = [entry["kind"] for entry in journal]
    resumed = kinds.index("session_resumed")
    assert "plan_adopted" in kinds[resumed:], "the robot answers what it found"


def test_turns_are_agreed_on_and_outlive_a_killed_painter(page: Page, studio: OpenStudio) -> None:
    page.evaluate("location.hash = '#/'")
    painting = page.evaluate(BEGIN.replace("strokes: 8", "strokes: 10"))
    page.get_by_role("button", name="Use plan 1").click()
    for box in page.locator(".check input").all():
        box.check()
    page.get_by_role("button", name="Start painting").click()
    page.get_by_role("button", name="Pause after this stroke").click(timeout=3 * PATIENCE)
    expect(page.get_by_role("button", name="Paint on the canvas yourself")).to_be_visible(timeout=3 * PATIENCE)
    form = page.locator("details", has_text="The robot's answer to what you paint")
    form.locator("summary").click()
    way = form.get_by_label("The robot's answer to what you paint")
    keep = form.locator("fieldset", has_text="What you paint")
    way.select_option("fill")
    expect(keep).to_be_hidden()  # that way says itself what may be painted on
    form.get_by_label("minutes").check()
    expect(form.locator("input[type=range]:visible")).to_have_attribute("max", "30")
    form.get_by_label("strokes", exact=True).check()
    way.select_option("continue")
    form.get_by_label("stays as it is").check()
    form.locator("input[type=range]:visible").fill("2")
    page.screenshot(path=SCREENSHOTS / "turn-form.png")
    page.set_viewport_size({"width": 390, "height": 844})
    form.scroll_into_view_if_needed()
    assert page.evaluate("document.documentElement.scrollWidth <= innerWidth")
    page.screenshot(path=SCREENSHOTS / "turn-form-phone.png")
    page.set_viewport_size({"width": 1280, "height": 860})
    form.get_by_role("button", name="Take turns").click()
    expect(page.get_by_text("the robot paints 2 strokes, then you paint")).to_be_visible()
    page.get_by_role("button", name="Paint on the canvas yourself").click()
    drag(page, (0.15, 0.5), (0.35, 0.5))
    drag(page, (0.45, 0.5), (0.65, 0.5))
    expect(page.get_by_text("2 strokes of yours")).to_be_visible()
    (folder,) = studio.folder.glob(f"*-{painting[:6]}")
    kill_worker(folder)
    page.get_by_role("button", name="Continue this painting").click()
    expect(page.get_by_text("The robot continues your drawing in its spirit.")).to_be_visible(timeout=3 * PATIENCE)
    expect(page.get_by_text(re.compile("It is your turn"))).to_be_visible(timeout=3 * PATIENCE)
    page.screenshot(path=SCREENSHOTS / "turns-continued.png")
    journal = EventLog.read(folder / "painting/journal")
    adopted = [entry for entry in journal if entry["kind"] == "plan_adopted"]
    assert adopted[-1]["answers"] and any(entry["kind"] == "region_protected" for entry in journal)


def test_without_a_goal_the_person_begins_and_the_robot_continues(page: Page, studio: OpenStudio) -> None:
    page.evaluate("location.hash = '#/'")
    page.get_by_role("link", name="New painting").click()
    page.get_by_role("button", name="+ No goal").click()
    expect(page.get_by_text("No goal: we draw together")).to_be_visible()
    page.get_by_label("Title").fill("A talk")
    assert complaints(page) == []
    page.screenshot(path=SCREENSHOTS / "together-composer.png")
    page.get_by_role("button", name="Draw together").click()
    expect(page.get_by_role("button", name="Start painting")).to_be_visible(timeout=3 * PATIENCE)
    for box in page.locator(".check input").all():
        box.check()
    page.screenshot(path=SCREENSHOTS / "together-prepare.png")
    page.get_by_role("button", name="Start painting").click()
    page.get_by_role("button", name="Paint on the canvas").click(timeout=3 * PATIENCE)
    page.locator(".person-brush").get_by_label("fine").check()
    for x in (0.15, 0.4, 0.65):
        drag(page, (x, 0.3), (x + 0.12, 0.45))
    expect(page.get_by_text("3 strokes of yours")).to_be_visible()
    page.get_by_role("button", name="Let the robot answer").click()
    expect(page.get_by_text("3 strokes of the robot; your turn")).to_be_visible(timeout=3 * PATIENCE)
    assert complaints(page) == []
    page.screenshot(path=SCREENSHOTS / "together-answered.png")
    page.set_viewport_size({"width": 390, "height": 844})
    assert page.evaluate("document.documentElement.scrollWidth <= innerWidth")
    page.screenshot(path=SCREENSHOTS / "together-phone.png")
    page.set_viewport_size({"width": 1280, "height": 860})
    (folder,) = studio.folder.glob(f"*-{page.url[-16:][:6]}")
    kill_worker(folder)
    page.get_by_role("button", name="Continue this painting").click()
    page.get_by_role("button", name="The drawing is finished").click(timeout=3 * PATIENCE)
    expect(page.get_by_text("3 strokes are on the canvas")).to_be_visible(timeout=3 * PATIENCE)
    page.screenshot(path=SCREENSHOTS / "together-finished.png", full_page=True)
