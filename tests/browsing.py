"""A studio in a process of its own, and windows on it in a real Chromium."""

import contextlib
import faulthandler
import os
import re
import select
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from axe_playwright_python.sync_playwright import Axe
from playwright.sync_api import Browser, Page, expect, sync_playwright

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
PATIENCE = 60_000  # ms; the machine that tests may be busy
SCREENSHOTS = Path(__file__).parents[1] / ".screenshots"  # of every run, for people to look at
ENOUGH = 600.0  # seconds for everything here; a browser that hangs is not waited for by any other clock
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


class OpenStudio:
    """A studio that is started, and may be killed and started again."""

    def __init__(self, folder: Path, *more: str) -> None:
        self.folder, self._more = folder, more
        self._start()

    def _start(self) -> None:
        program = [sys.executable, "-m", "frida_painter", "studio", "--folder", str(self.folder), "--port", "0"]
        self._process = subprocess.Popen(
            [*program, "--pace", "0.05", "--no-browser", *self._more],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, env={**os.environ},
        )  # fmt: skip
        assert self._process.stdin is not None and self._process.stdout is not None
        self._terminal, self._said = self._process.stdin, self._process.stdout
        assert select.select([self._said], [], [], 60)[0], "the studio says nothing"
        match = re.search(r"http://\S+", self._said.readline())
        assert match is not None
        self.address = match[0]

    def fall_over_and_be_started_again(self) -> None:
        """Killed; the new one has another address and other tokens."""
        self.kill()
        self._start()

    def press_enter(self) -> None:
        """Confirms, in the studio's terminal, that somebody stands beside the machine."""
        self._terminal.write("\n")
        self._terminal.flush()
        assert select.select([self._said], [], [], 60)[0]
        while "Pressed." not in self._said.readline():
            pass

    def close(self) -> None:
        """Ends it as a person does, and whatever a test that failed has left at work."""
        for painting in self.folder.glob("*/feed.jsonl"):
            painting.with_name("stop").touch()
        self._process.send_signal(signal.SIGINT)
        self._process.wait(120)

    def kill(self) -> None:
        """Ends it in any case."""
        self._process.kill()
        self._process.wait(10)
        self._terminal.close()
        self._said.close()


@contextmanager
def opened_studio(folder: Path, *more: str) -> Iterator[OpenStudio]:
    """A studio whose paintings are in that folder, with more options; it is closed in the end, whatever happens."""
    opened = OpenStudio(folder, *more)
    try:
        yield opened
        opened.close()
    finally:
        opened.kill()


@contextmanager
def chromium() -> Iterator[Browser]:
    """A browser without a display."""
    with sync_playwright() as playwright:
        opened = playwright.chromium.launch(executable_path=CHROMIUM, args=ARGUMENTS, timeout=PATIENCE)
        yield opened
        opened.close()


@contextmanager
def window(browser: Browser, studio: OpenStudio, width: int, height: int, **more: Any) -> Iterator[Page]:
    """A window of that size, in which nothing may go wrong unnoticed; more: as of `Browser.new_context`."""
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
    for path in Path("/proc").glob("[0-9]*/cmdline"):
        with contextlib.suppress(OSError):
            if (
                b"frida_painter_studio.worker_process" in path.read_bytes()
                and str(folder).encode() in path.read_bytes()
            ):
                os.kill(int(path.parent.name), signal.SIGKILL)


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
