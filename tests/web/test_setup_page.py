"""Setup of a machine on the page: its orders, and a whole setup in a browser over a simulated controller."""

import json
import re
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from axe_playwright_python.sync_playwright import Axe
from playwright.sync_api import Page, expect

from browsing import PATIENCE, SCREENSHOTS, WITH_CHROMIUM, OpenStudio, chromium, deadline, opened_studio, window
from frida_painter.event_log import FEED, EventLog
from frida_painter.hardware.workcell import WorkcellConfig
from frida_painter.runs.machine_setup import STEPS
from frida_painter.session.events import Answered, Asked, Failed, Remark
from frida_painter.session.setup_events import SetupLeft, SetupStarted, SetupStepBegan
from frida_painter.web.commands import Role
from frida_painter.web.jobs import SETUP_STEPS, Setup, SetupRequest
from frida_painter.web.painting_state import Truth
from frida_painter.web.studio_folder import Feed, WorkerLock
from frida_painter.web.workers import WorkerSlot
from machines.grbl import router
from machines.simulated_time import Living
from support.studio import Studio

GUIDE = {
    "id": "a" * 16, "kind": "guide", "text": "Guide it.", "position": [0.1, 0.1, 0.02], "lower": [0, 0, 0],
    "upper": [1, 1, 1], "again": False, "remark": "", "steps": [0.02, 0.01], "leave": True,
}  # fmt: skip


@pytest.fixture
def started(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    jobs: list[str] = []
    monkeypatch.setattr(WorkerSlot, "start", lambda self, job, plan: jobs.append(job))
    return jobs


def test_the_page_knows_the_steps_that_there_are() -> None:
    assert tuple(STEPS) == SETUP_STEPS


def test_nothing_is_set_up_unless_somebody_stands_beside_the_machine(tmp_path: Path, started: list[str]) -> None:
    studio = Studio(tmp_path)  # the virtual studio: but a setup moves a real machine
    visitor = studio.visitor()
    refused = visitor.post("/api/setup/start", json={})
    assert refused.status_code == 409 and "beside the robot" in refused.json()["sentence"] and started == []
    studio.presence.press()
    assert visitor.post("/api/setup/start", json={"brush": "fine"}).status_code == 200 and started == ["setup"]
    assert SetupRequest.load(studio.store.job("setup")).brush == "fine"
    assert visitor.post("/api/setup/start", json={}).status_code == 409, "a confirmation is good for one thing"
    for role in (Role.watch, Role.plan):
        assert studio.visitor(role).post("/api/setup/start", json={}).status_code == 403


@pytest.mark.parametrize(
    "asked",
    [{"easel": "../../etc"}, {"step": "dance"}, {"width": 100}, {"width": 1e9, "height": 100}, {"port": "/dev/x"},
     {"brush": "broom"}, {"easel": ""}],
)  # fmt: skip
def test_an_order_that_cannot_be_is_refused(tmp_path: Path, started: list[str], asked: dict[str, Any]) -> None:
    studio = Studio(tmp_path)
    studio.presence.press()
    assert studio.visitor().post("/api/setup/start", json=asked).status_code == 422 and started == []


def test_questions_of_the_setup_are_answered_and_left(tmp_path: Path, started: list[str]) -> None:
    studio = Studio(tmp_path)
    visitor, folder = studio.visitor(), studio.store.job("setup")
    Feed(folder).tell(Asked(GUIDE))
    answer = {"question": GUIDE["id"]}
    assert visitor.post("/api/setup/answer", json={**answer, "settled": True}).status_code == 409, "nobody waits for it"
    lock = WorkerLock(folder)
    assert lock.take()
    assert visitor.get("/api/work").json()["working"] == ["setup"] and visitor.get("/api/work").json()["moves"]
    assert visitor.post("/api/setup/answer", json={**answer, "yes": True}).status_code == 422
    assert visitor.post("/api/setup/answer", json={**answer, "move": [0.0, float("2"), 0.0]}).status_code == 422
    assert visitor.post("/api/setup/answer", json={**answer, "move": [0.01, 0.0, 0.0]}).status_code == 200
    assert visitor.post("/api/setup/answer", json={**answer, "leave": True}).status_code == 200
    kept = [line["reply"] for line in EventLog.read(folder.replies, FEED)]
    assert kept[0]["move"] == [0.01, 0.0, 0.0] and kept[1]["leave"] is True
    second = studio.visitor().post("/api/setup/answer", json={**answer, "settled": True})
    assert second.status_code == 409 and second.json()["led"] is True
    assert studio.visitor().post("/api/stop").status_code == 200 and folder.stop.exists()
    lock.release()


def test_its_state_follows_the_feed() -> None:
    state = Setup()
    for event in (SetupStarted(), SetupStepBegan("touch"), Remark("Not so deep."), Asked(GUIDE)):
        state.hear(event)
    shown = state.to_plain(Truth(working=True))
    assert (shown["step"], shown["remarks"], shown["question"]) == ("touch", ["Not so deep."], GUIDE)
    state.hear(Answered())
    assert "without saying why" in state.to_plain(Truth(working=False))["trouble"]
    state.hear(SetupLeft("You left."))
    left = state.to_plain(Truth(working=False))
    assert left["left"] == "You left." and left["trouble"] == ""
    state.hear(SetupStarted())
    state.hear(Failed("It is gone."))
    assert state.to_plain(Truth(working=False))["trouble"] == "It is gone."
    json.dumps(shown)


def test_a_page_that_follows_the_setup_is_a_sign_for_its_worker(tmp_path: Path) -> None:
    studio = Studio(tmp_path)
    sign = studio.store.job("setup").followed
    for name, follows in (("calibration", False), ("setup", True)):
        topic = studio.web.topic(name)
        assert topic is not None
        topic.mark()
        assert sign.exists() == follows


@pytest.mark.slow
def test_stop_ends_a_motion_of_the_setup_and_a_person_must_arm_the_machine(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("DATA", "CONFIG", "STATE"):
        monkeypatch.setenv(f"XDG_{name}_HOME", str(tmp_path / name))
    studio, machine = Studio(tmp_path / "studio"), router()
    visitor = studio.visitor()

    def wait_for(what: Callable[[dict[str, Any]], object]) -> dict[str, Any]:
        until = time.monotonic() + PATIENCE / 1000
        while not what(state := visitor.get("/api/setup").json()):
            assert time.monotonic() < until, state
            time.sleep(0.02)
        return state

    def answer(words: str, **given: Any) -> None:
        asked = wait_for(lambda state: words in (state["question"] or {}).get("text", ""))["question"]
        reply = visitor.post("/api/setup/answer", json={"question": asked["id"], **given})
        assert reply.status_code == 200, reply.text

    with Living(machine, pace=10) as living:
        studio.presence.press()
        assert visitor.post("/api/setup/start", json={}).status_code == 200
        things = wait_for(lambda state: state["question"])["question"]["things"]
        answer("Which machine", choice=next(i for i, thing in enumerate(things) if thing.startswith("GRBL router")))
        answer("Take the cutter out", yes=True)
        answer("Set the work zero", yes=True)
        asked = wait_for(lambda state: "port" in (state["question"] or {}).get("text", ""))["question"]
        if asked["kind"] == "choose":
            answer("At which port", choice=len(asked["things"]) - 1)
        answer("The name of its port", address=living.name)
        answer("bottom left", settled=True)
        asked = wait_for(lambda state: "bottom right" in (state["question"] or {}).get("text", ""))["question"]
        assert asked["leave"] is True
        living.pace = 0.5  # from now on slower than real
        visitor.post("/api/setup/answer", json={"question": asked["id"], "move": [-0.1, 0.0, 0.0]})
        wait_for(lambda _: machine.queue.speed > 0)
        assert visitor.post("/api/stop").status_code == 200
        living.pace = 5
        state = wait_for(lambda state: not state["working"])
        assert state["stopped"] and machine.queue.speed == 0
        assert machine.tip[0] > 1000 * asked["position"][0] - 100 + 1, "it did not go all the way"
        studio.presence.press()
        assert visitor.post("/api/setup/start", json={"easel": "grbl-router"}).status_code == 200
        refused = wait_for(lambda state: not state["working"] and state["trouble"])
        assert "frida-painter arm" in refused["trouble"]


def keep(page: Page, name: str) -> None:
    page.screenshot(path=SCREENSHOTS / f"{name}.png")


def start(page: Page, studio: OpenStudio, name: str) -> None:
    """Presses Enter beside the machine, then the button."""
    studio.press_enter()
    page.get_by_role("button", name=name, exact=True).click()


def there(page: Page) -> None:
    page.get_by_role("button", name="It is there").click()


def asked(page: Page, words: str) -> None:
    expect(page.locator(".question .text")).to_contain_text(words, timeout=PATIENCE)


def yes(page: Page, words: str) -> None:
    asked(page, words)
    page.get_by_role("button", name="Yes").click()


@pytest.mark.slow
@WITH_CHROMIUM
def test_a_machine_is_set_up_on_a_phone_left_and_continued_at_a_desk(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("DATA", "CONFIG", "STATE"):
        monkeypatch.setenv(f"XDG_{name}_HOME", str(tmp_path / name))
    SCREENSHOTS.mkdir(exist_ok=True)
    machine = router()
    with (
        Living(machine, pace=20) as living,
        opened_studio(tmp_path / "studio") as studio,
        deadline(),
        chromium() as browser,
    ):
        with window(browser, studio, 390, 780, has_touch=True, color_scheme="dark") as phone:
            phone.get_by_role("link", name="Set up a machine").click()
            phone.get_by_text("More settings").click()
            phone.get_by_label("Width of the canvas, mm").fill("120")
            phone.get_by_label("Height of the canvas, mm").fill("90")
            assert phone.locator(".brand img").evaluate("mark => mark.offsetWidth") > 20, "the bar has room for all"
            keep(phone, "setup-phone-welcome")
            start(phone, studio, "Choose a machine")
            asked(phone, "Which machine is it?")
            keep(phone, "setup-phone-presets")
            phone.get_by_role("button", name=re.compile("GRBL router")).click()
            yes(phone, "Take the cutter out")
            yes(phone, "Set the work zero")
            expect(phone.locator(".question .text")).to_contain_text(re.compile("port"), timeout=PATIENCE)
            if phone.get_by_role("button", name="Another one").count():
                phone.get_by_role("button", name="Another one").click()
            phone.get_by_label("Address").fill(living.name)
            phone.get_by_role("button", name="Connect").click()
            asked(phone, "bottom left corner")
            before = machine.tip.copy()
            phone.get_by_role("button", name="Left").click()
            expect(phone.locator(".guide .place strong").first).to_have_text(f"{before[0] - 10:.1f}", timeout=PATIENCE)
            phone.get_by_role("button", name="Right").click()  # back: the step shrinks
            expect(phone.locator(".guide .place strong").first).to_have_text(f"{before[0] - 5:.1f}", timeout=PATIENCE)
            keep(phone, "setup-phone-guide")
            assert phone.evaluate("document.documentElement.scrollWidth") <= 390
            there(phone)
            asked(phone, "bottom right corner")
            there(phone)
            asked(phone, "Shall it go down until it feels")
            phone.get_by_role("button", name="No").click()
            asked(phone, "Lower the brush until")
            keep(phone, "setup-phone-touch")
            phone.get_by_role("button", name="Leave, and continue later").click()
            expect(phone.get_by_role("button", name="Continue", exact=True)).to_be_visible(timeout=PATIENCE)
            keep(phone, "setup-phone-left")
        with window(browser, studio, 1280, 860) as desk:
            desk.goto(studio.address.split("/?")[0] + "/#/setup")
            desk.evaluate("async () => { await (await import('/static/api.js')).post('/api/lead'); }")
            start(desk, studio, "Continue")
            asked(desk, "Shall it go down until it feels")
            desk.get_by_role("button", name="No").click()
            for times, key in ((3, "Shift+ArrowDown"), (1, "")):
                for _ in range(times):
                    height = desk.locator(".jog strong").inner_text()
                    desk.keyboard.press(key or "ArrowDown")
                    expect(desk.locator(".jog strong")).not_to_have_text(height, timeout=PATIENCE)
                desk.get_by_role("button", name="The height is right").click()
                asked(desk, "Now lower it" if times == 3 else "uneven")
            keep(desk, "setup-desk-uneven")
            desk.get_by_role("button", name="No").click()
            asked(desk, "How many wells")
            desk.get_by_role("button", name="3", exact=True).click()
            for words in ("first well", "last well", "the water", "the rag"):
                asked(desk, words)
                height = desk.locator(".guide .place strong").last.inner_text()
                desk.keyboard.press("PageDown")
                expect(desk.locator(".guide .place strong").last).not_to_have_text(height, timeout=PATIENCE)
                if words == "the rag":
                    keep(desk, "setup-desk-guide")
                desk.locator(".guide").press("Enter")
            yes(desk, "Was that right?")
            yes(desk, "Lay a sheet of paper")
            yes(desk, "three strokes")
            expect(desk.get_by_text("Your machine is set up.")).to_be_visible(timeout=PATIENCE)
            expect(desk.locator("img.sheet")).to_have_js_property("complete", True)
            assert desk.locator("img.sheet").evaluate("sheet => sheet.naturalWidth") > 600
            keep(desk, "setup-desk-finished")
    found = WorkcellConfig.load(tmp_path / "DATA" / "frida-painter" / "easels" / "grbl-router" / "workspace.toml")
    assert found.touch_height == pytest.approx(0.0) and found.press_height == pytest.approx(-0.001)
    assert found.workspace.canvas_origin[0] == pytest.approx(before[0] / 1000 - 0.005, abs=1e-4)
    assert len(found.workspace.wells) == 3
    assert np.array(machine.moved)[1:, 2].min() == pytest.approx(-1.0, abs=0.05), "the hardest stroke, nothing lower"


def focused(page: Page) -> str:
    """The name of what the keyboard acts on."""
    return str(
        page.evaluate(
            "() => { const e = document.activeElement; "
            "return (e.getAttribute('aria-label') || e.textContent || '').trim(); }"
        )
    )


def tab_to(page: Page, name: str) -> None:
    """Presses Tab until something with that name has the focus, as a person without a mouse does."""
    for _ in range(80):
        if re.search(name, focused(page)):
            return
        page.keyboard.press("Tab")
    raise AssertionError(f"the Tab key does not come to {name}; it is at {focused(page)!r}")


@pytest.mark.slow
@WITH_CHROMIUM
def test_a_machine_is_set_up_by_keyboard_alone_and_axe_finds_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("DATA", "CONFIG", "STATE"):
        monkeypatch.setenv(f"XDG_{name}_HOME", str(tmp_path / name))
    machine, faults = router(), set[str]()
    with (
        Living(machine, pace=20) as living,
        opened_studio(tmp_path / "studio") as studio,
        deadline(),
        chromium() as browser,
        window(browser, studio, 1280, 860) as page,
    ):

        def inspect() -> None:
            found = Axe().run(page).response["violations"]
            faults.update(f"{each['id']}: {[node['target'] for node in each['nodes']][:3]}" for each in found)

        def press(*keys: str) -> None:
            for key in keys:
                page.keyboard.press(key)

        def agree(words: str, key: str = "Yes") -> None:
            asked(page, words)
            tab_to(page, f"^{key}$")
            press("Enter")

        tab_to(page, "Set up a machine")
        press("Enter")
        expect(page.get_by_role("heading", name="Set up a machine")).to_be_visible()
        inspect()
        tab_to(page, "^More settings$")
        press("Enter")
        for name, side in (("Width", "120"), ("Height", "90")):
            tab_to(page, f"^{name} of the canvas, mm$")
            page.keyboard.type(side)
        inspect()
        studio.press_enter()
        for _ in range(60):  # back, as a person who looks for the button does
            if focused(page) == "Choose a machine":
                break
            press("Shift+Tab")
        press("Enter")
        asked(page, "Which machine is it?")
        inspect()
        tab_to(page, "GRBL router")
        press("Enter")
        agree("Take the cutter out")
        agree("Set the work zero")
        expect(page.locator(".question .text")).to_contain_text(re.compile("port"), timeout=PATIENCE)
        if page.get_by_role("button", name="Another one").count():
            tab_to(page, "Another one")
            press("Enter")
        expect(page.get_by_label("Address")).to_be_focused(timeout=PATIENCE)
        inspect()
        page.keyboard.type(living.name)
        press("Enter")
        for words in ("bottom left", "bottom right"):
            asked(page, words)
            expect(page.locator(".guide")).to_be_focused(timeout=PATIENCE)
            if words == "bottom left":
                before = page.locator(".guide .place strong").first.inner_text()
                press("ArrowLeft")
                expect(page.locator(".guide .place strong").first).not_to_have_text(before, timeout=PATIENCE)
                inspect()
            expect(page.locator(".guide")).to_be_focused(timeout=PATIENCE)
            press("Enter")
        agree("Shall it go down until it feels", "No")
        asked(page, "Lower the brush until")
        inspect()
        for count, then in ((3, "Now lower it"), (1, "uneven")):
            for _ in range(count):
                height = page.locator(".jog strong").inner_text()
                press("Shift+ArrowDown" if count == 3 else "ArrowDown")
                expect(page.locator(".jog strong")).not_to_have_text(height, timeout=PATIENCE)
            tab_to(page, "The height is right")
            press("Enter")
            asked(page, then)
        agree("uneven", "No")
        asked(page, "How many wells")
        inspect()
        tab_to(page, "^3$")
        press("Enter")
        for words in ("first well", "last well", "the water", "the rag"):
            asked(page, words)
            expect(page.locator(".guide")).to_be_focused(timeout=PATIENCE)
            press("Enter")
        for words in ("Was that right?", "Lay a sheet of paper", "three strokes"):
            agree(words)
        expect(page.get_by_text("Your machine is set up.")).to_be_visible(timeout=PATIENCE)
        inspect()
    assert faults == set()
    assert (tmp_path / "DATA" / "frida-painter" / "easels" / "grbl-router" / "workspace.toml").exists()
