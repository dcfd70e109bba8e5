"""A studio in a process of its own, and windows on it in a real Chromium."""

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
from playwright.sync_api import Browser, Page, expect, sync_playwright

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
PATIENCE = 60_000  # ms; the machine that tests may be busy
SCREENSHOTS = Path(__file__).parents[1] / ".screenshots"  # of every run, for people to look at
ENOUGH = 600.0  # seconds for everything here; a browser that hangs is not waited for by any other clock
ARGUMENTS = ["--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage"]
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

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._start()

    def _start(self) -> None:
        program = [sys.executable, "-m", "frida_painter", "studio", "--folder", str(self.folder), "--port", "0"]
        self._process = subprocess.Popen(
            [*program, "--pace", "0.05", "--no-browser"],
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
def opened_studio(folder: Path) -> Iterator[OpenStudio]:
    """A studio whose paintings are in that folder; it is closed in the end, whatever happens."""
    opened = OpenStudio(folder)
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
