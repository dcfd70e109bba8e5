"""The whole story in a real browser, on the virtual studio; skipped where there is no Chromium."""

import faulthandler
import os
import re
import select
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Browser, Page, expect, sync_playwright

from frida_painter import images
from scenes import picture

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
PATIENCE = 60_000  # ms; the machine that tests may be busy
ENOUGH = 280.0  # seconds for everything here; a browser that hangs is not waited for by any other clock
ARGUMENTS = ["--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage"]
pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(CHROMIUM is None, reason="there is no chromium; `make browser` installs it where it can"),
]


@pytest.fixture(scope="module", autouse=True)
def deadline() -> Iterator[None]:
    """Ends this process, hard, where a browser or its driver does not answer any more.

    Playwright waits on an event loop of its own, which an exception from outside (Ctrl-C, SIGALRM) breaks
    without ending the wait.
    """
    faulthandler.dump_traceback_later(ENOUGH, exit=True)
    yield
    faulthandler.cancel_dump_traceback_later()


@pytest.fixture(scope="module")
def address(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """The address that a studio prints."""
    folder = tmp_path_factory.mktemp("studio")
    program = [sys.executable, "-m", "frida_painter", "studio", "--folder", str(folder / "paintings"), "--port", "0"]
    studio = subprocess.Popen([*program, "--no-browser"], stdout=subprocess.PIPE, text=True, env={**os.environ})
    assert studio.stdout is not None
    try:
        assert select.select([studio.stdout], [], [], 60)[0], "the studio says nothing"
        match = re.search(r"http://\S+", studio.stdout.readline())
        assert match is not None
        yield match[0]
        for painting in (folder / "paintings").glob("*/feed.jsonl"):
            painting.with_name("stop").touch()  # whatever a test that failed has left at work
        studio.send_signal(signal.SIGINT)
        studio.wait(30)
    finally:
        studio.kill()
        studio.wait(10)
        studio.stdout.close()


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    with sync_playwright() as playwright:
        chromium = playwright.chromium.launch(executable_path=CHROMIUM, args=ARGUMENTS, timeout=PATIENCE)
        yield chromium
        chromium.close()


@pytest.fixture
def page(browser: Browser, address: str) -> Iterator[Page]:
    """A window on the studio, in which nothing may go wrong unnoticed."""
    context = browser.new_context(viewport={"width": 1280, "height": 860})
    window = context.new_page()
    window.set_default_timeout(PATIENCE)
    complaints: list[str] = []
    window.on("pageerror", lambda error: complaints.append(str(error)))
    window.goto(address)
    assert "token" not in window.url
    yield window
    context.close()
    assert complaints == []


@pytest.fixture(scope="module")
def photograph(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("photograph") / "disc_and_bar.png"
    images.save(picture(90, 120), path)
    return path


def say(page: Page, photograph: Path, strokes: int = 15) -> None:
    """Asks for a small painting of the photograph."""
    page.get_by_role("link", name="New painting").click()
    page.set_input_files("input[type=file]", photograph)
    page.get_by_label("A quick study").check()
    page.get_by_text("In detail").click()
    slide(page, "Strokes", 0)
    slide(page, "Paints to mix", 3)
    slide(page, "Looks at the canvas", 1)
    page.get_by_role("button", name="Plan it").click()


def slide(page: Page, label: str, value: int) -> None:
    page.get_by_label(label).fill(str(value))


def start(page: Page) -> None:
    page.get_by_role("button", name="Take plan 1").click()
    begin = page.get_by_role("button", name="Start painting")
    expect(begin).to_be_disabled()
    for box in page.locator(".check input").all():
        box.check()
    begin.click()


def test_a_painting_from_the_wish_to_the_gallery(page: Page, photograph: Path) -> None:
    say(page, photograph)
    expect(page.locator(".palette li")).to_have_count(3, timeout=PATIENCE)
    scrub = page.get_by_label("Strokes painted so far")
    scrub.fill("7")
    expect(page.get_by_text("7 of 15")).to_be_visible()
    expect(page.locator(".overlay .mark")).to_have_count(1, timeout=PATIENCE)
    start(page)
    expect(page.locator(".status")).to_have_text(re.compile(r"Stroke \d+ of 15"), timeout=PATIENCE)
    page.reload()
    expect(page.locator(".looks h3").first).to_be_visible(timeout=PATIENCE)
    expect(page.get_by_role("link", name="The painting, photographed")).to_be_visible(timeout=PATIENCE)
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
    expect(page.get_by_text("What shall we paint?")).to_be_visible()
    expect(page.locator(".shelf li")).to_have_count(0)
