"""Twelve journeys through the page in a real browser, all in one studio and one Chromium."""

import contextlib
import json
import re
import shutil
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from PIL import Image
from playwright.sync_api import Browser, Locator, Page, Route, TimeoutError, expect

from browsing import (
    BEGIN,
    PATIENCE,
    SCREENSHOTS,
    WITH_CHROMIUM,
    complaints,
    drag,
    kill_worker,
    require_stop_on_top,
    window,
)
from frida_painter.hardware.workcell import WorkcellConfig
from frida_painter.session.events import Advanced, CommandDone, Event, NewGoal, ResultFound, Stopped, WentOn
from frida_painter.system import images
from frida_painter.system.event_log import EventLog
from frida_painter_calibration.teaching.families import load_family
from frida_painter_studio.studio_folder import PaintingFolder
from frida_painter_together.commands import PAUSE, ROBOT_MOVES, Protect, Simple, TakeTurns
from frida_painter_together.inbox import Inbox
from machines.grbl import router
from machines.simulated_time import Living
from served import Served, opened_studio
from support.boat import BOAT
from support.planning import picture
from support.told import CHANGED, FINISHED, PAINTED, PAUSED, PERSON, PICTURES, PLANNED, PROTECTED, Told

pytestmark = [WITH_CHROMIUM, pytest.mark.timeout(560)]

LONG = 3 * PATIENCE
PHONE: dict[str, Any] = {"width": 390, "height": 844, "has_touch": True, "is_mobile": True, "color_scheme": "dark"}
Open = Callable[..., AbstractContextManager[Page]]


@pytest.fixture(scope="module")
def home(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of what the studio keeps outside of its paintings: machines that were set up."""
    return tmp_path_factory.mktemp("home")


@pytest.fixture(scope="module")
def studio(tmp_path_factory: pytest.TempPathFactory, home: Path) -> Iterator[Served]:
    folder = tmp_path_factory.mktemp("studio")
    (folder / "boat.py").write_text(BOAT)
    maker = f"command:{sys.executable} {folder / 'boat.py'} {{seed}} {{canvas}} {{out}} {{words}}"
    with pytest.MonkeyPatch.context() as patch:
        for name in ("DATA", "CONFIG", "STATE"):
            patch.setenv(f"XDG_{name}_HOME", str(home / name))
        with opened_studio(folder / "paintings", "--imagine", maker, "--pace", "0.05") as opened:
            for name, color in PICTURES.items():
                Image.new("RGB", (120, 90), color).save(opened.folder / "pictures" / f"{name}.png")
            yield opened


@pytest.fixture
def opens(browser: Browser, studio: Served) -> Open:
    """Opens a window on the studio, which gives the orders from then on."""

    @contextlib.contextmanager
    def opens(width: int = 1280, height: int = 860, **more: Any) -> Iterator[Page]:
        with window(browser, studio, width, height, **more) as page:
            lead(page)
            yield page
            page.unroute_all(behavior="ignoreErrors")

    return opens


def go(page: Page, place: str) -> None:
    page.evaluate("place => { location.hash = place; }", place)


def keep(page: Page, name: str) -> None:
    """A screenshot for people."""
    page.screenshot(path=SCREENSHOTS / f"{name}.png")


def lead(page: Page) -> None:
    page.evaluate("async () => { await (await import('/static/api.js')).post('/api/lead'); }")


def press(page: Page, name: str, *, patience: float = PATIENCE) -> None:
    exact = " " not in name  # one word is part of other names
    page.get_by_role("button", name=name, exact=exact).click(timeout=patience)


def sees(page: Page, words: str | re.Pattern[str], *, patience: float = PATIENCE) -> None:
    expect(page.get_by_text(words).first).to_be_visible(timeout=patience)


def heading(page: Page, words: str, *, patience: float = PATIENCE) -> None:
    expect(page.get_by_role("heading", name=words)).to_be_visible(timeout=patience)


def start(page: Page, plan: int = 1) -> None:
    """Starts a plan as soon as it is made, and waits until it is painted."""
    press(page, f"Use plan {plan}", patience=LONG)
    begin = page.get_by_role("button", name="Start painting")
    expect(begin).to_be_disabled()
    for box in page.locator(".check input").all():
        box.check()
    begin.click(timeout=PATIENCE)  # enabled once the planner's process has ended
    heading(page, "Paint together")


def fits(page: Page) -> None:
    """Nothing is wider than the window."""
    assert page.evaluate("document.documentElement.scrollWidth <= innerWidth")


def in_sight(page: Page, selector: str) -> bool:
    """Whether all of an element can be seen, below the header."""
    found = page.locator(selector).bounding_box()
    size, header = page.viewport_size, page.locator(".bar").bounding_box()
    assert found is not None and size is not None and header is not None
    return found["y"] >= header["height"] and found["y"] + found["height"] <= size["height"]


def folder_of(studio: Served, painting: str) -> Path:
    (folder,) = studio.folder.glob(f"*-{painting[:6]}")
    return folder


def with_more(page: Page, change: Callable[[dict[str, Any]], object]) -> None:
    """Changes what the studio tells this page about itself."""

    def answer(route: Route) -> None:
        told = route.fetch()
        facts = told.json()
        change(facts)
        route.fulfill(response=told, json=facts)

    page.route("**/api/studio", answer)
    page.reload()


def test_a_photograph_becomes_a_painting_in_the_gallery(opens: Open, studio: Served, tmp_path: Path) -> None:
    photograph = tmp_path / "disc_and_bar.png"
    images.save(picture(90, 120), photograph)
    with opens() as page:
        page.get_by_role("link", name="New painting").click()
        page.set_input_files("input[type=file]", photograph)
        page.get_by_label("Quick study").check()
        page.get_by_text("More settings").click()
        for label, value in (("Strokes", 0), ("Paints to mix", 2), ("Replans", 1)):
            page.get_by_label(label).fill(str(value))
        press(page, "Make a plan")
        expect(page.get_by_role("button", name="Use plan 1")).to_be_visible(timeout=LONG)
        assert page.locator(".palette li").count() in (2, 3), (
            "one each for disc and bar; a third if it paints something"
        )
        page.get_by_label("Strokes painted so far").fill("7")
        sees(page, "7 of 15")
        expect(page.locator(".overlay .mark")).to_have_count(1, timeout=PATIENCE)
        keep(page, "plan")
        start(page)
        expect(page.locator(".status")).to_have_text(re.compile(r"Stroke \d+ of 15"), timeout=PATIENCE)
        place = page.url.partition("#")[2]
        studio.fall_over_and_be_started_again()  # the painting goes on
        page.goto(studio.address)
        sees(page, "What do you want to paint?")
        go(page, place)
        expect(page.locator(".looks h3").first).to_be_visible(timeout=LONG)
        expect(page.get_by_role("link", name="The painting, to print", exact=True)).to_be_visible(timeout=LONG)
        keep(page, "finished")
        film = page.locator("video")
        film.evaluate("async film => { film.muted = true; await film.play(); }")
        assert film.evaluate("film => film.videoWidth") > 0
        with page.expect_download() as taken:
            page.get_by_role("link", name="Everything").click()
        assert taken.value.path().stat().st_size > 10_000
        page.get_by_role("link", name="Gallery").click()
        page.get_by_role("link", name="disc and bar").click()
        page.on("dialog", lambda dialog: dialog.accept())
        press(page, "Delete")
        sees(page, "What do you want to paint?")
        expect(page.get_by_role("link", name="disc and bar")).to_have_count(0)


AGAIN = """async (id) => {
  const api = await import("/static/api.js");
  const { wish } = (await api.get(`/api/paintings/${id}`)).plans[0];
  await api.post(`/api/paintings/${id}/plans`, { ...wish, strokes: 10, effort: 0.05 });
}"""


def test_planning_and_painting_are_stopped_with_two_browsers_one_of_them_a_tablet(opens: Open) -> None:
    with opens() as page, opens(820, 1180) as tablet:
        lead(page)
        begun = page.evaluate(BEGIN.replace("strokes: 8, effort: 0.05", "strokes: 300, effort: 2"))
        expect(page.get_by_label("Planning")).to_be_visible()
        press(page, "Stop")
        heading(page, "You stopped the planning")
        expect(page.get_by_role("button", name="Plan again")).to_be_enabled(timeout=PATIENCE)
        page.evaluate(AGAIN, begun)
        expect(page.get_by_role("button", name="Use plan 2")).to_be_visible(timeout=LONG)
        go(tablet, f"#/p/{begun}")
        expect(tablet.get_by_role("button", name="Use plan 2")).to_be_visible()
        fits(tablet)
        start(page, 2)
        press(tablet, "Pause after this stroke", patience=LONG)  # the easel opens as fast as the machine has time
        press(tablet, "Take control and continue")
        expect(page.get_by_role("button", name="Continue", exact=True)).to_be_visible(timeout=LONG)
        press(tablet, "Protect a part")
        stroke(tablet, (0.1, 0.2), (0.1, 0.8))
        press(tablet, "Do not paint in this part")
        for each in (page, tablet):
            expect(each.locator(".hatching").first).to_be_visible(timeout=LONG)
        keep(tablet, "protected-tablet")
        press(tablet, "Continue", patience=LONG)
        expect(page.get_by_role("button", name="Pause after this stroke")).to_be_visible(timeout=LONG)
        page.keyboard.press("Escape")
        page.keyboard.press("Escape")
        for each in (page, tablet):
            sees(each, "You stopped after", patience=LONG)
        press(tablet, "Continue this painting")  # a simulated robot needs nobody who has looked
        heading(page, "Paint together")
        until = time.monotonic() + 150
        while page.get_by_text("are on the canvas").count() == 0 and time.monotonic() < until:
            asked = tablet.locator(".question").get_by_role("button", name="No", exact=True)
            if asked.count():
                with contextlib.suppress(TimeoutError):  # the page was just drawn anew: it asks again
                    asked.click(timeout=2000)
            tablet.wait_for_timeout(100)
        sees(page, "10 strokes are on the canvas")


CALIBRATE = """async () => {
  const api = await import("/static/api.js");
  await api.post("/api/calibration/start", { what: ["canvas", "brush"], brush: "fine", width: 160, height: 120 });
}"""


def test_corners_are_dragged_and_the_brush_is_lowered_with_a_jog_key(opens: Open) -> None:
    with opens() as page:
        page.get_by_role("link", name="Calibrate").click()
        expect(page.get_by_role("button", name="Run: Canvas position")).to_be_enabled()
        page.evaluate(CALIBRATE)  # two at once, which load what they need but once
        corner = page.get_by_label("The top left corner")
        expect(corner).to_be_visible(timeout=LONG)
        found = place(corner)
        move_corner(page, corner, (30, 20), (2, 0))
        expect(corner).not_to_have_attribute("aria-valuetext", described(found))
        dragged = place(corner)
        assert dragged[0] > found[0] and abs(dragged[1] - found[1]) <= 1
        corner.press("ArrowLeft")
        expect(corner).to_have_attribute("aria-valuetext", described((dragged[0] - 1, dragged[1])))
        press(page, "These are the corners")
        press(page, "Save the length")
        press(page, "No")  # not by looking
        height = page.locator(".jog strong")
        expect(height).to_be_visible(timeout=PATIENCE)
        before = float(height.inner_text().removesuffix(" mm"))
        page.keyboard.press("ArrowDown")
        expect(height).to_have_text(f"{before - 1:.1f} mm")
        page.get_by_label("Up by 0.2 mm").click()
        expect(height).to_have_text(f"{before - 0.8:.1f} mm")
        keep(page, "jog")
        press(page, "The height is right")
        sees(page, "the bristles are spread")
        page.get_by_label("Down by 5 mm").click()
        expect(height).to_have_text(f"{before - 5.8:.1f} mm")
        press(page, "The height is right")
        expect(page.locator(".procedures .done")).to_have_count(2, timeout=PATIENCE)
        keep(page, "calibrated")


def move_corner(page: Page, corner: Locator, over: tuple[int, int], to: tuple[int, int]) -> None:
    """Takes hold of a handle and leaves it `to` pixels of the page away, by way of a place that is `over` away."""
    expect(page.locator(".mount.photograph img")).to_have_js_property("complete", True)
    corner.hover()  # which waits until it stands still, lies in the window, and nothing lies over it
    box = corner.bounding_box()
    assert box is not None
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    page.mouse.move(x, y)
    page.mouse.down()
    expect(page.locator(".loupe")).to_be_visible()  # it is held
    for across, down in (over, to):
        page.mouse.move(x + across, y + down, steps=2)
    page.mouse.up()
    expect(page.locator(".loupe")).to_be_hidden()  # and let go: every motion before was heard


def described(place: tuple[int, int]) -> str:
    """What a handle that stands there tells of itself."""
    return f"column {place[0]}, row {place[1]}"


def place(corner: Locator) -> tuple[int, int]:
    """Where a handle stands, in pixels of the photograph."""
    column, row = re.findall(r"\d+", corner.get_attribute("aria-valuetext") or "")
    return int(column), int(row)


PAINT = """async (id) => {
  const api = await import("/static/api.js");
  const stroke = { kind: "paint", brush: "broad", paint: 0, points: [[0.5, 0.5, 0.5, 0, 0, 0]] };
  try { await api.post(`/api/paintings/${id}/say`, stroke); } catch (error) { return error.message; }
  return "";
}"""


def test_one_of_three_variants_is_chosen_and_painted(opens: Open, studio: Served, tmp_path: Path) -> None:
    photograph = tmp_path / "disc_and_bar.png"
    images.save(picture(90, 120), photograph)
    with opens() as page:
        go(page, "#/new")
        page.set_input_files("input[type=file]", photograph)
        page.get_by_text("More settings").click()
        for label in ("Strokes", "Paints to mix", "Replans"):
            page.get_by_label(label).fill("0")
        page.get_by_role("button", name="Three variants").press("Enter")
        cards = page.get_by_role("region", name="Plans").get_by_role("button")
        expect(cards).to_have_count(3, timeout=LONG)
        sees(page, "Ready: 1 of 3 variants. Choose one.", patience=LONG)
        assert complaints(page) == []
        press(page, "Stop")
        expect(cards.first).to_contain_text("strokes")
        press(page, "Three variants", patience=LONG)
        sees(page, "Ready: 3 of 3 variants. Choose one.", patience=LONG)
        assert complaints(page) == []
        expect(cards).to_have_count(6)
        cards.nth(5).press("Enter")
        expect(cards.nth(5)).to_have_attribute("aria-pressed", "true")
        expect(cards.nth(5)).to_be_focused()
        expect(cards.nth(5)).to_contain_text(re.compile(r"^Plan 6: graphic15 strokes, \d paints?, (about|roughly) "))
        keep(page, "variants")
        page.reload()
        expect(cards).to_have_count(6)
        cards.nth(5).click()
        press(page, "Use plan 6")
        for box in page.locator(".check input").all():
            box.check()
        press(page, "Start painting")
        heading(page, "Paint together")
        press(page, "Stop", patience=LONG)
        sees(page, re.compile("You stopped"), patience=LONG)
        painted = folder_of(studio, page.url.rpartition("/")[2])
    assert json.loads((painted / "plans/6/.settings.json").read_text())["new_paints"] is False
    assert not (painted / "plans/5/.settings.json").exists()


def test_a_person_paints_asks_for_a_boat_and_what_they_painted_outlives_a_killed_painter(
    opens: Open, studio: Served
) -> None:
    with opens() as page:
        painting = page.evaluate(BEGIN)
        start(page)
        expect(page.get_by_role("button", name="Pause after this stroke")).to_be_visible(timeout=LONG)
        assert page.evaluate(PAINT, painting) == ROBOT_MOVES
        press(page, "Pause after this stroke")
        press(page, "Paint on the canvas yourself", patience=LONG)
        drag(page, (0.1, 0.15), (0.5, 0.2), (0.9, 0.15))
        sees(page, "1 stroke of yours")
        page.locator(".person-brush").get_by_label("fine").check()
        page.get_by_role("button", name="Paint 2").click()
        pad = page.locator(".stroke-pad canvas")
        pad.focus()
        for key in ("Shift+ArrowUp", "Shift+ArrowUp", " ", "Shift+ArrowRight", " "):  # by keyboard
            pad.press(key)
        sees(page, "2 strokes of yours")
        keep(page, "person-brush")
        press(page, "Back to the painting")
        page.get_by_text("Change it by words").click()
        page.get_by_label("What shall change").fill("add a boat")
        page.get_by_label("What shall change").press("Enter")
        shelf = page.get_by_role("list", name="Pictures of add a boat")
        expect(shelf.get_by_role("button")).to_have_count(4, timeout=LONG)
        sees(page, "What you painted stays in all of them.")
        assert complaints(page) == []
        keep(page, "by-words-proposed")
        folder = folder_of(studio, painting)
        kill_worker(folder)
        press(page, "Continue this painting")
        expect(shelf).to_have_count(0)  # it is taken up
        expect(shelf.get_by_role("button")).to_have_count(4, timeout=LONG)
        shelf.get_by_role("button", name="Paint towards picture 2 of 4, seed").press("Enter")
        sees(page, "Made from “add a boat” by command", patience=LONG)
        press(page, "Continue", patience=LONG)
        sees(page, "8 strokes are on the canvas", patience=LONG)
        keep(page, "by-words-painted")
    journal = list(EventLog.read(folder / "painting/journal"))
    kinds = [entry["result"]["kind"] if entry["kind"] == "command_done" else entry["kind"] for entry in journal]
    made, changed, resumed = (kinds.index(kind) for kind in ("pictures", "goal", "session_resumed"))
    assert kinds.index("region") < made < resumed < changed
    laid = [
        entry["stroke"] for entry in EventLog.read(folder / "painting/studio.diary") if entry.get("did") == "person"
    ]
    begun = [entry for entry in journal if entry["kind"] == "stroke_of_person" and not entry["painted"]]
    assert laid == [entry["stroke"] for entry in begun]
    assert [(each["number"], each["brush"], each["paint"]) for each in laid][1:] == [(2, "fine", 1)]
    (change,) = json.loads((folder / "painting/result.json").read_text())["goal_changes"]
    assert "“add a boat” by command" in change["goal"][0] and 0 < change["strokes"] < 8
    assert json.loads((folder / "painting/changes/2/goal/1/making.json").read_text())["because"] == "a person chose it"


def test_without_a_goal_the_person_begins_and_the_robot_continues(opens: Open, studio: Served) -> None:
    with opens() as page:
        page.get_by_role("link", name="New painting").click()
        press(page, "+ No goal")
        sees(page, "No goal: we draw together")
        page.get_by_label("Title").fill("A talk")
        assert complaints(page) == []
        press(page, "Draw together")
        expect(page.get_by_role("button", name="Start painting")).to_be_visible(timeout=LONG)
        for box in page.locator(".check input").all():
            box.check()
        press(page, "Start painting")
        page.get_by_role("button", name="Paint on the canvas").click(timeout=LONG)
        page.locator(".person-brush").get_by_label("fine").check()
        for x in (0.15, 0.4, 0.65):
            drag(page, (x, 0.3), (x + 0.12, 0.45))
        sees(page, "3 strokes of yours")
        press(page, "Let the robot answer")
        sees(page, "3 strokes of the robot; your turn", patience=LONG)
        assert complaints(page) == []
        page.set_viewport_size({"width": 390, "height": 844})
        fits(page)
        keep(page, "together-phone")
        page.set_viewport_size({"width": 1280, "height": 860})
        kill_worker(folder_of(studio, page.url[-16:]))
        press(page, "Continue this painting")
        press(page, "The drawing is finished", patience=LONG)
        sees(page, "3 strokes are on the canvas", patience=LONG)
        keep(page, "together-finished")


def test_a_stroke_is_taught_by_ten_marks_and_can_be_chosen(opens: Open, studio: Served) -> None:
    with opens() as page:
        go(page, "#/teach")
        for number in range(10):
            if number == 9:
                sees(page, "9 marks drawn, 1 more to go.")
                expect(page.get_by_role("button", name="Teach this stroke")).to_be_disabled()
            size, left, top = 0.17 + 0.01 * (number % 7), 0.06 + 0.3 * (number % 3), 0.15 + 0.2 * (number // 3)
            ends = ((0.0, 0.0), (0.35, 0.01), (0.7, 0.0), (0.85, 0.3 + 0.02 * (number % 4)), (1.0, 0.6))
            drag(page, *((left + size * x, top + size * y) for x, y in ends))
        page.get_by_label("Name of the stroke").fill("hook")
        page.get_by_label("Strokes to learn from").fill("0")
        press(page, "Teach this stroke")
        expect(page.locator(".taught figure", has_text="hook")).to_be_visible(timeout=LONG)
        sheet = page.locator(".taught img").first
        sheet.scroll_into_view_if_needed()
        assert sheet.evaluate("async image => { await image.decode(); return image.naturalWidth; }") == 1200
        assert complaints(page) == []
        page.set_viewport_size({"width": 390, "height": 844})
        fits(page)
        keep(page, "taught-phone")
        page.set_viewport_size({"width": 1280, "height": 860})
        least, most = load_family(studio.folder / "families/hook.safetensors").size
        assert least < 0.024 < most, "a fifth of the pad, which is 120 mm wide"
        go(page, "#/new")
        page.get_by_text("More settings").click()
        expect(page.locator("select option", has_text='the stroke "hook"')).to_have_count(1)


def test_a_machine_is_set_up_on_a_phone_left_and_continued_at_a_desk_by_keyboard(
    opens: Open, studio: Served, home: Path
) -> None:
    machine, faults = router(), list[str]()
    with Living(machine, pace=20) as living:
        with opens(**{**PHONE, "height": 780}) as phone:
            phone.get_by_role("link", name="Set up a machine").tap()
            phone.get_by_text("More settings").tap()
            phone.get_by_label("Width of the canvas, mm").fill("120")
            phone.get_by_label("Height of the canvas, mm").fill("90")
            assert phone.locator(".brand img").evaluate("mark => mark.offsetWidth") > 20, "the bar has room for all"
            studio.press_enter()
            press(phone, "Choose a machine")
            asked(phone, "Which machine is it?")
            faults += complaints(phone)
            phone.get_by_role("button", name=re.compile("GRBL router")).tap()
            for words in ("Take the cutter out", "Set the work zero"):
                asked(phone, words)
                press(phone, "Yes")
            asked(phone, "port")
            if phone.get_by_role("button", name="Another one").count():
                press(phone, "Another one")
            phone.get_by_label("Address").fill(living.name)
            press(phone, "Connect")
            for words in ("drive to its limit switches", "From now on the tip moves"):
                asked(phone, words)
                press(phone, "Yes")
            asked(phone, "bottom-left corner")
            before = machine.tip.copy()
            for way, moved in (("Left", 10), ("Right", 5)):  # back: the step shrinks
                press(phone, way)
                expect(phone.locator(".guide .place strong").first).to_have_text(f"{before[0] - moved:.1f}")
            keep(phone, "setup-phone-guide")
            fits(phone)
            press(phone, "It is there")
            asked(phone, "bottom-right corner")
            press(phone, "It is there")
            asked(phone, "Shall it go down until it feels")
            press(phone, "No")
            asked(phone, "Lower the brush until")
            press(phone, "Leave, and continue later")
            expect(phone.get_by_role("button", name="Continue", exact=True)).to_be_visible(timeout=PATIENCE)
        with opens() as desk:
            tab_to(desk, "Set up a machine")
            desk.keyboard.press("Enter")
            expect(desk.get_by_role("button", name="Continue", exact=True)).to_be_visible()
            studio.press_enter()
            tab_to(desk, "^Continue$")
            desk.keyboard.press("Enter")
            agree(desk, "From now on the tip moves", "Yes")
            agree(desk, "Shall it go down until it feels", "No")
            for times, key, then in ((3, "Shift+ArrowDown", "Now lower it"), (1, "ArrowDown", "uneven")):
                for _ in range(times):
                    height = desk.locator(".jog strong").inner_text()
                    desk.keyboard.press(key)
                    expect(desk.locator(".jog strong")).not_to_have_text(height, timeout=PATIENCE)
                faults += complaints(desk)
                tab_to(desk, "The height is right")
                desk.keyboard.press("Enter")
                asked(desk, then)
            agree(desk, "uneven", "No")
            asked(desk, "How many wells")
            tab_to(desk, "^3$")
            desk.keyboard.press("Enter")
            for words in ("first well", "last well", "the water", "the rag"):
                asked(desk, words)
                expect(desk.locator(".guide")).to_be_focused(timeout=PATIENCE)
                height = desk.locator(".guide .place strong").last.inner_text()
                desk.keyboard.press("PageDown")
                expect(desk.locator(".guide .place strong").last).not_to_have_text(height, timeout=PATIENCE)
                desk.locator(".guide").press("o")
            for words in ("Was that right?", "Lay a sheet of paper", "three strokes"):
                agree(desk, words)
            sees(desk, "Your machine is set up.")
            expect(desk.locator("img.sheet")).to_have_js_property("complete", True)
            assert desk.locator("img.sheet").evaluate("sheet => sheet.naturalWidth") > 600
            faults += complaints(desk)
            keep(desk, "setup-desk-finished")
    assert faults == []
    found = WorkcellConfig.load(home / "DATA" / "frida-painter" / "easels" / "grbl-router" / "workspace.toml")
    assert found.touch_height == pytest.approx(0.0) and found.press_height == pytest.approx(-0.001)
    assert found.workspace.canvas_origin[0] == pytest.approx(before[0] / 1000 - 0.005, abs=1e-4)
    assert len(found.workspace.wells) == 3
    assert min(place[2] for place in machine.moved[1:]) == pytest.approx(-1.0, abs=0.05), "the hardest stroke"


def asked(page: Page, words: str) -> None:
    expect(page.locator(".question .text")).to_contain_text(words, timeout=PATIENCE)


def agree(page: Page, words: str, key: str = "Yes") -> None:
    asked(page, words)
    tab_to(page, f"^{key}$")
    page.keyboard.press("Enter")


def focused(page: Page) -> str:
    """The name of what the keyboard acts on."""
    name = "e.getAttribute('aria-label') || e.textContent || ''"
    return str(page.evaluate(f"() => {{ const e = document.activeElement; return ({name}).trim(); }}"))


def tab_to(page: Page, name: str) -> None:
    """Presses Tab until something with that name has the focus, as a person without a mouse does."""
    for _ in range(80):
        if re.search(name, focused(page)):
            return
        page.keyboard.press("Tab")
    raise AssertionError(f"the Tab key does not come to {name}; it is at {focused(page)!r}")


def test_a_painting_is_shown_from_its_plan_to_its_card(opens: Open, studio: Served) -> None:
    requested, made = PLANNED
    assert isinstance(made, ResultFound)
    with opens(1440, 900) as desk:
        told = replace(made, detail={**made.detail, "remarks": ["Not shown: 'a kite'."]})
        Told(studio, requested, told).show(desk)
        expect(desk.get_by_role("heading", name="Review the plan")).to_be_focused()
        sees(desk, "Not shown: 'a kite'.")
        press(desk, "Goal")
        fade = desk.get_by_label("Fade between goal, plan")
        plan = desk.get_by_alt_text("The finished plan")
        for share in ("0", "0.5"):
            fade.fill(share)
            assert plan.evaluate("image => getComputedStyle(image).opacity") == share
        expect(desk.get_by_role("list", name="The goal").get_by_text("Paint this picture")).to_be_visible()
        sees(desk, "Painting it takes")
        keep(desk, "plan-told")
        desk.get_by_role("button", name="Use plan 1").press("Enter")
        expect(desk.get_by_role("heading", name="Prepare")).to_be_focused()
        painting = Told(studio, *PLANNED, *PAINTED)
        with painting.at_work():
            painting.show(desk)
            expect(desk.get_by_alt_text("The canvas after 3 strokes")).to_be_visible()
            assert in_sight(desk, ".easel .mount:visible") and in_sight(desk, ".easel-state")
            box = desk.locator(".easel .mount:visible").bounding_box()
            assert box is not None and box["height"] >= 0.55 * 900
            expect(desk.locator(".easel-state")).to_contain_text("paint 2, 3 strokes since the dip")
            sees(desk, re.compile(r"^about \d+ \w+ left$"))
            painting.tell(PAUSED)
            expect(desk.locator(".easel-state")).to_contain_text("stands still, arm aside")
            painting.tell(*PROTECTED, PAUSED)
            expect(desk.locator(".looks")).to_contain_text("so that no stroke touches the protected part.")
            expect(desk.locator(".looks")).to_contain_text("20 % farther from the goal than the old ones")
            painting.tell(CommandDone(NewGoal("changes/1", CHANGED, 3)), PAUSED)
            goal = desk.get_by_role("list", name="The goal")
            expect(goal.get_by_alt_text("Drawing")).to_be_visible()
            expect(goal.get_by_text("weight: high")).to_be_visible()
            keep(desk, "paint-told")
            painting.tell(*FINISHED)
        sees(desk, "40 strokes are on the canvas")
        expect(desk.locator("video")).to_have_attribute("poster", re.compile(f"{painting.id}/painting/painting.png"))
        line = desk.get_by_role("slider", name="Before and after")
        line.press("ArrowLeft")
        expect(line).to_have_attribute("aria-valuetext", "49 % goal, 51 % painting")
        with desk.expect_download() as saved:
            press(desk, "Save the card")
        assert saved.value.suggested_filename == "Cup-card.png"
        card = Image.open(saved.value.path())
        assert card.width == 1500 and card.getpixel((750, 400)) == (250, 0, 250, 255), "the painting itself"
        desk.emulate_media(media="print")
        expect(desk.locator(".bar")).to_be_hidden()
        expect(desk.locator(".card")).to_be_visible()


def test_in_a_pause_parts_are_protected_and_turns_agreed_on(opens: Open, studio: Served) -> None:
    painting = Told(studio, *PLANNED, *PAINTED, *PERSON, PAUSED)
    with painting.at_work(), opens(1440, 900) as page:
        painting.show(page)
        expect(page.get_by_role("button", name="Protect a part")).to_be_visible()
        page.keyboard.press("m")
        surface = page.locator(".pad canvas")
        expect(surface).to_be_focused()
        page.keyboard.press("Space")
        for _ in range(8):
            page.keyboard.press("Shift+ArrowLeft")
        page.keyboard.press("Space")
        expect(page.get_by_text("Pen up, 10 % from the left, 50 % from the top")).to_be_attached()
        undo, redo = page.get_by_role("button", name="Undo"), page.get_by_role("button", name="Redo")
        undo.click()
        assert not inked(page, 0.3, 0.5)
        redo.click()
        assert inked(page, 0.3, 0.5)
        surface.focus()
        page.keyboard.press("Control+z")
        assert not inked(page, 0.3, 0.5)
        page.keyboard.press("Control+Shift+Z")
        assert inked(page, 0.3, 0.5)
        press(page, "Clear")
        stroke(page, (0.3, 0.3), (0.7, 0.3), (0.7, 0.7), (0.3, 0.7), (0.3, 0.32))
        assert not inked(page, 0.5, 0.5)
        press(page, "Mark the inside too")
        assert inked(page, 0.5, 0.5) and not inked(page, 0.1, 0.1)
        keep(page, "lasso")
        press(page, "Clear")
        surface.press("0")
        page.get_by_role("button", name="Zoom in").click()
        page.get_by_role("button", name="Zoom in").click()
        expect(page.get_by_role("button", name="Show the whole sheet")).to_have_text("225 %")
        stroke(page, (0.5, 0.5), (0.9, 0.5))  # of the window: the sheet's middle, and 0.18 of it to the right
        assert inked(page, 0.6, 0.5) and not inked(page, 0.75, 0.5)
        page.get_by_role("button", name="Do not paint in this part").press("Enter")
        expect(page.locator(".pad")).to_be_hidden()
        assert focused(page) == "Continue"
        drawn = Image.open(painting.folder.pictures / f"{said(painting.folder, Protect).picture}.png").convert("L")
        places = [(int(drawn.width * x), drawn.height // 2) for x in (0.3, 0.6, 0.8)]
        assert [drawn.getpixel(place) for place in places] == [0, 255, 0]
        way_of = "The robot's answer to what you paint"
        form = page.locator("details", has_text=way_of)
        form.locator("summary").click()
        way = form.get_by_label(way_of)
        way.select_option("fill")
        expect(form.locator("fieldset", has_text="What you paint")).to_be_hidden()  # that way says itself what may be
        form.get_by_label("minutes").check()
        expect(form.locator("input[type=range]:visible")).to_have_attribute("max", "30")
        form.get_by_label("strokes", exact=True).check()
        way.select_option("continue")
        form.get_by_label("stays as it is").check()
        form.locator("input[type=range]:visible").fill("2")
        keep(page, "turn-form")
        form.get_by_role("button", name="Take turns").click()
        assert said(painting.folder, TakeTurns) == TakeTurns(2, 0.0, "continue", "protect")


def said(folder: PaintingFolder, kind: type[Any]) -> Any:
    """The last command of a kind that the painter would hear; waits until it is there."""
    heard, until = Inbox(folder.painting, 0.0), time.monotonic() + 60
    found: list[Any] = []
    while not found and time.monotonic() < until:  # the page shows it before the server has written it
        found = [each.command for each in heard.listen() if isinstance(each.command, kind)]
        time.sleep(0.05)
    return found[-1]


def stroke(page: Page, *through: tuple[float, float]) -> None:
    """A line through these places with the mouse, in shares of the pad's window."""
    page.locator(".pad").scroll_into_view_if_needed()
    box = page.locator(".pad").bounding_box()
    assert box is not None
    places = [(box["x"] + x * box["width"], box["y"] + y * box["height"]) for x, y in through]
    page.mouse.move(*places[0])
    page.mouse.down()
    for each in places[1:]:
        page.mouse.move(*each, steps=5)
    page.mouse.up()


def inked(page: Page, x: float, y: float) -> bool:
    """Whether something is drawn at a place of the sheet, in shares of its sides."""
    script = """async (canvas, [x, y]) => {
      await new Promise((resolve) => requestAnimationFrame(() => requestAnimationFrame(resolve)));
      return canvas.getContext("2d").getImageData(x * canvas.width, y * canvas.height, 1, 1).data[3] > 0;
    }"""
    return bool(page.locator(".pad canvas").evaluate(script, [x, y]))


PASTE = """async (text) => {
  const moved = new DataTransfer();
  if (text) moved.setData("text/plain", text);
  else {
    const sheet = document.createElement("canvas");
    const blob = await new Promise((resolve) => sheet.toBlob(resolve, "image/png"));
    moved.items.add(new File([blob], "tea-pot.png", { type: "image/png" }));
  }
  document.body.dispatchEvent(new ClipboardEvent("paste", { clipboardData: moved, bubbles: true, cancelable: true }));
}"""


def test_a_goal_is_pasted_drawn_made_from_words_or_taken_from_an_example(opens: Open, studio: Served) -> None:
    with opens(1440, 900) as desk:
        go(desk, "#/new")
        expect(desk.get_by_role("heading", name="Set the goal")).to_be_focused()
        bare = desk.get_by_role("button", name="Choose a picture")
        expect(bare).to_be_visible()
        desk.evaluate(PASTE, "")
        expect(desk.get_by_label("Title")).to_have_value("tea pot")
        desk.get_by_label("Detailed").check()
        desk.reload()
        expect(desk.get_by_label("Title")).to_have_value("tea pot")  # a draft stays
        expect(desk.get_by_label("Detailed")).to_be_checked()
        press(desk, "Start over")
        expect(desk.locator(".terms li")).to_have_count(0)
        expect(bare).to_be_visible()
        desk.evaluate(PASTE, "a ship  at dusk")
        expect(desk.get_by_label("What to paint")).to_have_value("a ship at dusk")
        desk.get_by_role("button", name="Make pictures from this text").press("Enter")
        expect(desk.get_by_role("button", name="Stop making pictures")).to_be_focused()
        made = desk.get_by_role("list", name="Pictures of a ship at dusk").get_by_role("button")
        expect(made).to_have_count(4)
        expect(desk.get_by_role("button", name="Make others, with another seed")).to_be_focused()
        assert complaints(desk) == []
        keep(desk, "made-pictures")
        desk.get_by_role("button", name="Begin with picture 3 of 4, seed 2").press("Enter")
        expect(desk.get_by_role("button", name="Remove: Picture")).to_be_focused()
        sees(desk, re.compile("Made from “a ship at dusk” by command.*seed 2"))
        expect(desk.get_by_role("button", name="Make a plan")).to_be_enabled()
        press(desk, "Start over")
        expect(bare).to_be_visible()
        with_more(desk, lambda facts: facts["abilities"]["sketch"].update(ready=True))
        desk.get_by_role("button", name="+ Drawing").press("Enter")
        expect(desk.locator(".pad canvas")).to_be_focused()
        for key in ("Enter", *["Shift+ArrowRight"] * 3, *["Shift+ArrowDown"] * 3, "Enter"):
            desk.keyboard.press(key)
        uploads: list[Route] = []
        desk.route("**/api/pictures", lambda route: uploads.append(route))  # it does not end until we say so
        desk.get_by_role("button", name="Use this drawing").press("Enter")
        sees(desk, "The picture is on its way to the studio.")
        press(desk, "Make a plan")
        expect(desk.get_by_role("button", name="Taking in the picture …")).to_be_disabled()
        uploads[0].abort()
        sees(desk, "The studio does not answer")
        expect(desk.locator(".pad canvas")).to_be_visible()  # nothing is lost
        desk.unroute("**/api/pictures")
        desk.get_by_role("button", name="Use this drawing").press("Enter")
        expect(desk.get_by_alt_text("Drawing", exact=True)).to_be_visible()
        assert focused(desk) == "+ Drawing"
        press(desk, "Start over")
    with opens(**PHONE) as phone:
        phone.route("**/api/paintings", lambda route: route.fulfill(json=[]))
        go(phone, "#/new")
        with phone.expect_file_chooser():
            phone.get_by_role("button", name="Choose a picture").tap()
        go(phone, "#/")
        phone.get_by_role("button", name="Paint this one: Chelsea the cat").click()
        expect(phone.get_by_alt_text("The picture to paint")).to_have_js_property("naturalWidth", 451)
        sheet = phone.get_by_role("application", name="The picture on the canvas")
        sheet.press("+")
        sheet.press("ArrowLeft")
        sees(phone, "125 %")
        with phone.expect_request("**/api/paintings") as sent:
            press(phone, "Make a plan")  # (the route above answers it)
        left, top, width, height = sent.value.post_data_json["terms"][0]["crop"]
        assert top > 0 and left < (1 - width) / 2 and width == pytest.approx(0.8, abs=1e-3) == height
        keep(phone, "example-taken")


STOPPED_PLAN: list[Event] = [PLANNED[0], Advanced("", 0.3, 20.0), Stopped()]
AWAY = """() => {
  window.told = [];
  const state = { get: () => (window.away ? "hidden" : "visible"), configurable: true };
  Object.defineProperty(document, "visibilityState", state);
  document.hasFocus = () => !window.away;
  Object.defineProperty(Notification, "permission", { get: () => "granted", configurable: true });
  ServiceWorkerRegistration.prototype.showNotification = async (title, { body }) => { window.told.push(body); };
  window.away = true;
}"""


def test_what_happens_elsewhere_is_seen_queued_told_and_stopped_from_the_gallery(opens: Open, studio: Served) -> None:
    waiting, painting = Told(studio, *PLANNED), Told(studio, *PLANNED, *PAINTED)
    with opens(1440, 900) as desk, opens(**PHONE) as phone:
        lead(desk)
        live = re.compile("live")
        stop = desk.get_by_role("button", name="Stop", exact=True)
        expect(stop).not_to_have_class(live)
        with waiting.at_work():  # so that the queue does not begin it
            waiting.show(desk)
            press(desk, "Use plan 1")
            press(desk, "Paint it after the others")
            sees(desk, "It waits in the queue, and is painted when")
            go(desk, "#/")
            queue = desk.get_by_role("region", name="Queue")
            expect(queue.get_by_role("listitem")).to_contain_text("to be painted")
            keep(desk, "queue")
            queue.get_by_role("button", name="Remove").click()
            expect(queue).to_be_hidden()
        place = stop.bounding_box()
        with painting.at_work():
            expect(stop).to_have_class(live)
            assert stop.bounding_box() == place  # it is always where one reaches for it
            sees(desk, "being painted")
            with_more(desk, lambda facts: facts.update(camera=True))
            Image.new("RGB", (64, 48), (200, 30, 30)).save(painting.folder.camera)
            painting.show(desk)
            seen = desk.get_by_alt_text("What the camera sees now")
            expect(seen).to_be_visible()
            painting.folder.camera.unlink()
            expect(seen).to_be_hidden()
            desk.evaluate("navigator.serviceWorker.ready")
            desk.evaluate(AWAY)
            painting.tell(replace(PAUSED, cause="turn"))
            expect(desk).to_have_title("● Cup · The studio")
            assert desk.evaluate("window.told") == ["Cup: it is your turn to paint."]
            desk.evaluate("() => { window.away = false; window.dispatchEvent(new Event('focus')); }")
            expect(desk).to_have_title("Cup · The studio")
            painting.tell(WentOn())
            painting.show(phone)
            expect(phone.get_by_role("button", name="Pause after this stroke")).to_be_visible()
        for page in (desk, phone):  # its painter was killed
            sees(page, "The painter's process ended in the middle of its work")
            expect(page.get_by_role("button", name="Continue this painting")).to_be_enabled()
            expect(page.get_by_role("button", name="Pause after this stroke")).to_have_count(0)
        keep(phone, "killed-phone")
        Told(studio, *STOPPED_PLAN).show(phone)
        heading(phone, "You stopped the planning")
        shutil.rmtree(painting.folder.path)
        sees(desk, "Nothing of it is left")
        desk.once("dialog", lambda dialog: dialog.accept())
        press(desk, "Remove it from the gallery")
        sees(desk, "What do you want to paint?")
        expect(desk.locator(f".shelf a[href='#/p/{painting.id}']")).to_have_count(0)


@pytest.mark.parametrize("role", ["watch", "plan", "operate"])
def test_a_role_sees_what_it_is_and_no_form_that_it_may_not_use(browser: Browser, studio: Served, role: str) -> None:
    plan = {"Make another plan", "Plan with these changes", "New painting"}
    hidden = {"watch": plan | {"Use plan 1", "Calibrate"}, "plan": {"Use plan 1", "Calibrate"}, "operate": set[str]()}
    painting, stopped = Told(studio, *PLANNED), Told(studio, *PLANNED, *PAINTED, Stopped())
    context = browser.new_context(viewport={"width": 390 if role == "plan" else 1440, "height": 850})
    context.route("**/api/studio", lambda route: route.fulfill(json={**route.fetch().json(), "role": role}))
    page = context.new_page()
    page.goto(studio.address)
    page.wait_for_url("**/#/")
    sees(page, "What do you want to paint?")
    expect(page.locator("#role")).to_have_text({"watch": "You watch", "plan": "You plan", "operate": ""}[role])
    painting.show(page)
    heading(page, "Review the plan")
    if role != "watch":
        page.get_by_text("Change the goal").click()
    names = [*plan, "Use plan 1", "Calibrate", "Stop"]
    shown = {
        name: page.get_by_role("button", name=name).or_(page.get_by_role("link", name=name)).first for name in names
    }
    assert {name for name, one in shown.items() if not one.is_visible()} == hidden[role]
    fits(page)
    stopped.show(page)
    sees(page, "You stopped after 3 strokes")
    expect(page.get_by_role("button", name="Continue this painting")).to_have_count(1 if role == "operate" else 0)
    keep(page, f"role-{role}")
    context.close()


def test_on_a_phone_all_is_in_reach_and_control_is_taken_with_one_button(opens: Open, studio: Served) -> None:
    planned, painted = Told(studio, *PLANNED), Told(studio, *PLANNED, *PAINTED)
    with painted.at_work(), opens(**PHONE) as phone, opens(800, 600) as other:
        for place, name in (
            ("#/new", "Make a plan"),
            (f"#/p/{planned.id}", "Use plan 1"),
            (f"#/p/{painted.id}", "Pause after this stroke"),
        ):
            go(phone, place)
            expect(phone.get_by_role("button", name=name)).to_be_visible()
            assert phone.evaluate("document.querySelector('.bar').offsetHeight") <= 64
            fits(phone)
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
            require_stop_on_top(phone)
        lead(other)
        phone.get_by_role("button", name="Pause after this stroke").tap()
        take = phone.get_by_role("button", name="Take control and continue")
        expect(take).to_be_visible()
        keep(phone, "take-control")
        take.tap()
        expect(phone.locator("#notice")).to_be_empty()
        expect(phone.get_by_role("button", name="It will pause after this stroke")).to_be_visible()
        assert said(painted.folder, Simple) == PAUSE
        painted.tell(PAUSED)
        phone.get_by_role("button", name="Protect a part").tap()
        expect(phone.locator(".pad")).to_be_visible()
        assert in_sight(phone, ".pad") and in_sight(phone, ".tools")
        keep(phone, "phone-pad")
        other.keyboard.press("n")
        expect(other.get_by_role("heading", name="Set the goal")).to_be_focused()
        other.keyboard.press("?")
        heading(other, "Keyboard shortcuts")
        other.get_by_label("Use shortcuts of one letter").uncheck()
        other.keyboard.press("Escape")
        other.locator("h1").focus()
        other.keyboard.press("g")
        heading(other, "Set the goal")
