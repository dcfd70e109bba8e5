"""The page's stop and its one stream, in a real browser; skipped where there is no Chromium."""

import contextlib
import threading
import time
from collections.abc import Iterator
from datetime import datetime, timedelta
from http.client import HTTPConnection
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any, ClassVar

import pytest
from playwright.sync_api import Browser, BrowserContext, Page, expect

from browsing import SCREENSHOTS, WITH_CHROMIUM, require_stop_on_top
from frida_painter.session.events import Began, Stopped
from frida_painter_studio.at_page import Feed
from frida_painter_studio.store import PaintingStore
from frida_painter_studio.studio_folder import PaintingRequest
from served import Served, Work, end_listener, open_studio

pytestmark = WITH_CHROMIUM
WAIT = 60_000  # ms


@pytest.fixture(scope="module")
def studio(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    served = open_studio(tmp_path_factory.mktemp("studio") / "paintings")
    yield served
    served.kill()
    end_listener(served.folder)


@pytest.fixture
def work(studio: Served) -> Iterator[Work]:
    working = Work(PaintingStore(studio.folder))
    painting_request = PaintingRequest.model_validate({"terms": [{"kind": "text", "words": "a ship"}]})
    Feed(working.folder.path).tell(Began("plan", plan=1, detail=painting_request.model_dump(mode="json")))
    yield working
    working.lock.release()


@pytest.fixture
def context(browser: Browser) -> Iterator[BrowserContext]:
    opened = browser.new_context()
    opened.set_default_timeout(WAIT)
    yield opened
    opened.close()


def enter(context: BrowserContext, studio: Served, view: str = "", **facts: Any) -> Page:
    """Opens a page; `facts` stand for what the studio tells of itself."""
    if facts:
        context.route("**/api/studio", lambda route: route.fulfill(json={**route.fetch().json(), **facts}))
    page = context.new_page()
    token = "" if context.cookies() else f"?token={studio.tokens['operate']}"
    page.goto(f"http://{studio.host}:{studio.port}/{token}")
    if token:
        page.wait_for_url(f"http://{studio.host}:{studio.port}/#/")
    page.locator("#view > *").first.wait_for()
    if view:
        page.evaluate("view => { location.hash = view; }", view)
    return page


def stop(page: Page) -> None:
    page.get_by_role("button", name="Stop", exact=True).click()


def require_arrived(page: Page) -> None:
    """A stop was answered; on a machine that is busy the page may say how late, but not that it did not arrive."""
    expect(page.locator("button.pressed")).to_have_count(0, timeout=WAIT)
    alarm = page.locator(".stop-alarm")
    assert alarm.is_hidden() or "did not arrive" not in alarm.inner_text()


def streams(studio: Served) -> int:
    """How many connections lead to the studio."""
    end = f"{int.from_bytes(bytes(map(int, studio.host.split('.')))[::-1], 'big'):08X}:{studio.port:04X}"
    rows = [row.split() for row in Path("/proc/net/tcp").read_text().splitlines()[1:]]
    return sum(row[2] == end and row[3] == "01" for row in rows)


@pytest.mark.parametrize("shared", [True, False], ids=["worker", "pages"])
def test_all_pages_of_one_painting_have_one_stream_and_each_of_them_stops(
    context: BrowserContext, studio: Served, work: Work, shared: bool
) -> None:
    if not shared:
        context.add_init_script("delete window.SharedWorker")
    pages = [enter(context, studio, f"#/p/{work.entry.id}") for _ in range(4)]
    for words in ("The first is told", "The second as well"):
        Feed(work.folder.path).tell(Stopped(words))
        for page in pages:
            expect(page.get_by_text(words)).to_be_visible(timeout=WAIT)
    patience = time.monotonic() + WAIT / 1000
    while streams(studio) > 2 and time.monotonic() < patience:  # connections that nobody needs are closed
        time.sleep(0.5)
    assert streams(studio) <= 2
    stop(pages[0])
    assert work.told.wait(WAIT / 1000)
    pages[3].keyboard.press("Escape")
    pages[3].keyboard.press("Escape")
    for page in pages:
        require_arrived(page)


def test_where_a_stop_cannot_arrive_the_page_says_so_within_two_seconds_and_stop_stays_in_reach(
    context: BrowserContext, studio: Served, work: Work
) -> None:
    page = enter(context, studio, dangerous=True)
    page.route("**/stop", lambda route: None)  # it is never answered
    page.clock.install()  # the page's own time, whatever else the machine does
    page.clock.pause_at(datetime.now() + timedelta(hours=1))
    stop(page)
    page.clock.run_for(1000)
    assert page.locator(".stop-alarm").is_hidden()
    page.clock.run_for(1000)
    expect(page.locator(".stop-alarm")).to_contain_text("emergency stop at the robot")
    page.screenshot(path=SCREENSHOTS / "stop-did-not-arrive.png")
    for view in ("#/", "#/new", "#/calibrate"):
        page.evaluate("view => { location.hash = view; }", view)
        require_stop_on_top(page)
    page.unroute("**/stop")
    page.clock.resume()
    assert work.told.wait(WAIT / 1000), "it is sent again"
    expect(page.locator(".stop-alarm")).to_contain_text("The stop arrived after", timeout=WAIT)
    page.get_by_role("button", name="I have looked at the robot", exact=True).last.click()
    expect(page.locator(".stop-alarm")).to_be_hidden()


def test_a_stop_is_acknowledged_at_once_and_all_other_buttons_rest_until_everything_stands(
    context: BrowserContext, studio: Served
) -> None:
    page, moves = enter(context, studio), [True]
    page.route("**/stop", lambda route: route.fulfill(json={"stopped": 1, "heard": 1}))
    page.route("**/api/work", lambda route: route.fulfill(json={**route.fetch().json(), "moves": moves[0]}))
    seen = page.evaluate("""() => {
      document.getElementById("stop").click();
      return [document.getElementById("notice").textContent, document.getElementById("view").inert];
    }""")
    assert seen[0].startswith("Stopping everything.") and seen[1]
    expect(page.get_by_text("The stop was heard.")).to_be_visible(timeout=WAIT)
    page.screenshot(path=SCREENSHOTS / "stop-heard.png")
    assert page.evaluate("document.getElementById('view').inert")
    moves[0] = False
    expect(page.get_by_text("Everything has stopped.")).to_be_visible(timeout=WAIT)
    expect(page.locator("#view[inert]")).to_have_count(0, timeout=WAIT)


@pytest.mark.parametrize("dangerous", [False, True])
def test_an_alarm_that_nobody_confirmed_ends_with_the_work_or_by_a_person_if_a_machine_may_have_moved(
    context: BrowserContext, studio: Served, dangerous: bool
) -> None:
    working = Work(PaintingStore(studio.folder))
    page = enter(context, studio, dangerous=dangerous)
    page.route("**/stop", lambda route: route.fulfill(json={"stopped": 1, "heard": 0}))
    stop(page)
    alarm = page.locator(".stop-alarm")
    says = "If the robot moves, use its emergency stop" if dangerous else "has not confirmed it"
    expect(alarm).to_contain_text(says, timeout=WAIT)
    with page.expect_response("**/api/work"), page.expect_response("**/api/work"):
        pass
    expect(alarm).to_contain_text(says)
    working.lock.release()
    if dangerous:
        for _ in range(3):
            with page.expect_response("**/api/work"):
                pass
        expect(alarm).to_be_visible()
        page.get_by_role("button", name="I have looked at the robot").click()
    else:
        expect(page.get_by_text("Everything has stopped.")).to_be_visible(timeout=WAIT)
    expect(alarm).to_be_hidden(timeout=WAIT)


def test_an_alarm_ends_by_itself_when_the_studio_is_back_and_nothing_can_move(
    context: BrowserContext, studio: Served
) -> None:
    page = enter(context, studio)
    context.set_offline(True)
    stop(page)
    alarm = page.locator(".stop-alarm")
    expect(alarm).to_contain_text("has not arrived yet", timeout=WAIT)
    require_stop_on_top(page)
    page.evaluate("location.hash = '#/new'")
    expect(alarm).to_be_visible()
    context.set_offline(False)
    expect(alarm).to_be_hidden(timeout=WAIT)
    require_arrived(page)


def test_a_stranger_is_told_how_to_come_in_and_where_to_stop(context: BrowserContext, studio: Served) -> None:
    page = context.new_page()
    page.goto(f"http://{studio.host}:{studio.port}/")
    expect(page.get_by_text("frida-painter studio --link")).to_be_visible(timeout=WAIT)
    expect(page.get_by_role("button", name="Stop")).to_be_hidden()
    expect(page.get_by_text("use its own emergency stop")).to_be_visible()


class _Neighbour(BaseHTTPRequestHandler):
    """Another server on this machine, which browsers send their cookies to; its page is a link."""

    link: ClassVar[str] = ""
    cookies: ClassVar[list[str]] = []

    def do_GET(self) -> None:
        self.cookies.append(self.headers.get("Cookie", ""))
        self.send_response(200)
        self.send_header("Content-Type", "text/html")
        self.end_headers()
        self.wfile.write(f'<a href="{self.link}">Come</a>'.encode())

    def log_message(self, *words: object) -> None:
        pass


@contextlib.contextmanager
def _neighbour(name: str) -> Iterator[str]:
    """Where a page of another server is, under that name of this machine."""
    with ThreadingHTTPServer(("127.0.0.1", 0), _Neighbour) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        yield f"http://{name}:{server.server_port}/"
        server.shutdown()


def test_a_server_on_another_port_gets_the_cookie_and_can_do_nothing_with_it_but_its_links_open_the_studio(
    context: BrowserContext, studio: Served, work: Work
) -> None:
    enter(context, studio)
    page, address = context.new_page(), f"http://{studio.host}:{studio.port}/"
    with _neighbour(studio.host) as elsewhere:
        page.goto(elsewhere)
        assert page.evaluate("localStorage.length") == 0
    signs = {"Cookie": next(filter(None, _Neighbour.cookies)), "Origin": address.rstrip("/"), "X-Page-Key": ""}
    for method, path in (
        ("GET", "/api/studio"),
        ("GET", "/api/paintings"),
        ("POST", "/api/lead"),
        ("POST", "/api/stop"),
    ):
        with contextlib.closing(HTTPConnection(studio.host, studio.port, timeout=30)) as connection:
            connection.request(method, path, headers=signs)
            assert connection.getresponse().status == 403
    assert not work.told.is_set()
    # By a server: a page that the test would answer for itself makes the browser tell less of where a click came from.
    with _neighbour("localhost") as elsewhere:
        for way in (f"{address}?token={studio.tokens['operate']}", address):
            _Neighbour.link = way
            page.goto(elsewhere)
            page.get_by_text("Come").click()
            expect(page.get_by_role("button", name="Stop", exact=True)).to_be_visible(timeout=WAIT)


def test_after_a_restart_an_old_page_stops_and_a_reload_says_how_to_come_in_again(
    context: BrowserContext, studio: Served, work: Work
) -> None:
    """The last test here: it replaces the studio."""
    page, reloaded = (enter(context, studio, f"#/p/{work.entry.id}") for _ in range(2))
    Feed(work.folder.path).tell(Stopped("The first is told"))
    expect(page.get_by_text("The first is told")).to_be_visible(timeout=WAIT)
    reloaded.set_viewport_size({"width": 390, "height": 844})
    reloaded.evaluate("navigator.serviceWorker.ready.then(() => {})")
    studio.kill()
    reloaded.reload()  # nobody answers; the page's service worker has kept a page for that
    expect(reloaded.get_by_role("heading", name="The studio does not answer")).to_be_visible(timeout=WAIT)
    require_stop_on_top(reloaded)
    again = open_studio(studio.folder, port=studio.port)
    try:
        expect(page.get_by_text("open the link that its terminal shows")).to_be_visible(timeout=WAIT)
        stop(page)
        assert work.told.wait(WAIT / 1000)
        require_arrived(page)
        expect(reloaded.get_by_role("heading", name="Open the studio with its link")).to_be_visible(timeout=WAIT)
        style = reloaded.evaluate("getComputedStyle(document.querySelector('.bar')).position")
        assert style == "sticky", "it has its style"
        assert reloaded.evaluate("document.documentElement.scrollWidth") <= 390
        reloaded.screenshot(path=SCREENSHOTS / "closed-unknown-phone.png")
        stop(reloaded)
        arrived = reloaded.get_by_text("The stop has arrived.").or_(reloaded.get_by_text("The stop arrived after"))
        expect(arrived).to_be_visible()
    finally:
        again.kill()
