"""Windows on a studio in a real Chromium."""

import contextlib
import faulthandler
import os
import shutil
import signal
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from axe_playwright_python.sync_playwright import Axe
from playwright.sync_api import Browser, Page, expect, sync_playwright

from served import Served

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
PATIENCE = 60_000  # ms; the machine that tests may be busy
SCREENSHOTS = Path(__file__).parents[1] / ".screenshots"  # of every run, for people to look at
ENOUGH = 600.0  # seconds from one window to the next; a browser that hangs is not waited for by any other clock
ARGUMENTS = ["--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage"]
BEGIN = """async () => {
  const api = await import("/static/api.js");
  await api.post("/api/lead");
  const sheet = document.createElement("canvas");
  [sheet.width, sheet.height] = [120, 90];
  const paper = sheet.getContext("2d");
  paper.fillStyle = "#eadfcb"; paper.fillRect(0, 0, 120, 90);
  paper.fillStyle = "#20603a"; paper.fillRect(30, 20, 60, 50);
  const picture = await api.upload(await new Promise((resolve) => sheet.toBlob(resolve)));
  const wish = { title: "Beside", strokes: 8, effort: 0.05, colors: 2, replans: 1, width: 160, height: 120 };
  const begun = await api.post("/api/paintings", { terms: [{ kind: "image", picture }], ...wish });
  location.hash = `#/p/${begun.id}`;
  return begun.id;
}"""
"""Begins a small painting on the page, and returns its id."""
WITH_CHROMIUM = pytest.mark.skipif(
    CHROMIUM is None, reason="there is no chromium; `make browser` installs it where it can"
)

expect.set_options(timeout=PATIENCE)


@contextmanager
def deadline() -> Iterator[None]:
    """Ends this process, hard, where a browser or its driver does not answer any more.

    Playwright waits on an event loop of its own, which an exception from outside (Ctrl-C, SIGALRM) breaks
    without ending the wait.
    """
    faulthandler.dump_traceback_later(ENOUGH, exit=True)
    yield
    faulthandler.cancel_dump_traceback_later()


@contextmanager
def chromium() -> Iterator[Browser]:
    """A browser without a display."""
    with sync_playwright() as playwright:
        opened = playwright.chromium.launch(executable_path=CHROMIUM, args=ARGUMENTS, timeout=PATIENCE)
        yield opened
        opened.close()


@contextmanager
def window(browser: Browser, studio: Served, width: int, height: int, **more: Any) -> Iterator[Page]:
    """A window of that size, in which nothing may go wrong unnoticed; more: as of `Browser.new_context`."""
    faulthandler.dump_traceback_later(ENOUGH, exit=True)
    context = browser.new_context(viewport={"width": width, "height": height}, **more)
    opened = context.new_page()
    opened.set_default_timeout(PATIENCE)
    complaints: list[str] = []
    opened.on("pageerror", lambda error: complaints.append(str(error)))
    opened.goto(studio.address)
    opened.wait_for_url("**/#/")  # without the token, and without the key
    expect(opened.get_by_text("What do you want to paint?")).to_be_visible(timeout=PATIENCE)  # it knows the studio now
    yield opened
    opened.goto("about:blank")  # it says that it is left, and leads no longer
    context.close()
    assert complaints == []


def kill_worker(folder: Path) -> None:
    """Kills the process that paints in a folder."""
    for log in Path("/proc").glob("[0-9]*/fd/2"):
        with contextlib.suppress(OSError):
            if log.resolve() == folder.resolve() / "worker.log":
                os.kill(int(log.parts[2]), signal.SIGKILL)


def drag(page: Page, *places: tuple[float, float]) -> None:
    """Paints through these places, shares of the pad."""
    box = page.locator(".stroke-pad canvas").bounding_box()
    assert box is not None
    for number, (x, y) in enumerate(places):
        page.mouse.move(box["x"] + x * box["width"], box["y"] + y * box["height"], steps=1 if number == 0 else 6)
        if number == 0:
            page.mouse.down()
    page.mouse.up()


def complaints(page: Page) -> list[str]:
    """The faults that axe finds, with the places in the page."""
    found = Axe().run(page).response["violations"]
    return [f"{each['id']}: {each['help']}: {[node['target'] for node in each['nodes']][:4]}" for each in found]


def require_stop_on_top(page: Page) -> None:
    """Nothing lies over Stop, at any of its corners."""
    box = page.locator("#stop").bounding_box()
    assert box is not None
    for across in (0.15, 0.5, 0.85):
        for down in (0.15, 0.5, 0.85):
            at = [box["x"] + across * box["width"], box["y"] + down * box["height"]]
            assert page.evaluate("([x, y]) => document.elementFromPoint(x, y)?.id", at) == "stop"
