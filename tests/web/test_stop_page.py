"""The page's stop and its one stream, in a real browser; skipped where there is no Chromium."""

import contextlib
import threading
import time
from collections.abc import Iterator
from datetime import datetime, timedelta
from http.client import HTTPConnection
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import ClassVar

import pytest
from playwright.sync_api import Browser, BrowserContext, Page, expect

from browsing import SCREENSHOTS, WITH_CHROMIUM, chromium, deadline
from frida_painter.session.events import Failed, PlanRequested
from frida_painter.web.store import PaintingStore
from frida_painter.web.studio_folder import Feed, PaintingRequest
from served import Served, Work, end_listener, open_studio

pytestmark = [pytest.mark.slow, WITH_CHROMIUM]
WAIT = 60_000  # ms


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    with deadline(), chromium() as opened:
        yield opened


@pytest.fixture
def studio(tmp_path: Path) -> Iterator[Served]:
    served = open_studio(tmp_path / "paintings")
    yield served
    served.kill()
    end_listener(served.folder)


@pytest.fixture
def work(studio: Served) -> Iterator[Work]:
    working = Work(PaintingStore(studio.folder))
    painting_request = PaintingRequest.model_validate({"terms": [{"kind": "text", "words": "a ship"}]})
    Feed(working.folder).tell(PlanRequested(1, painting_request.model_dump(mode="json")))
    yield working
    working.lock.release()


@pytest.fixture
def context(browser: Browser) -> Iterator[BrowserContext]:
    opened = browser.new_context()
    opened.set_default_timeout(WAIT)
    yield opened
    opened.close()


def enter(context: BrowserContext, studio: Served, view: str = "") -> Page:
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
def test_seven_pages_of_one_painting_have_one_stream_and_each_of_them_stops(
    context: BrowserContext, studio: Served, work: Work, shared: bool
) -> None:
    if not shared:
        context.add_init_script("delete window.SharedWorker")
    pages = [enter(context, studio, f"#/p/{work.entry.id}") for _ in range(7)]
    feed = Feed(work.folder)
    feed.tell(Failed("The first is told"))
    for page in pages:
        expect(page.get_by_text("The first is told")).to_be_visible(timeout=WAIT)
    feed.tell(Failed("The second as well"))
    for page in pages:
        expect(page.get_by_text("The second as well")).to_be_visible(timeout=WAIT)
    patience = time.monotonic() + WAIT / 1000
    while streams(studio) > 2 and time.monotonic() < patience:  # connections that nobody needs are closed
        time.sleep(0.5)
    assert streams(studio) <= 2
    stop(pages[0])
    assert work.told.wait(WAIT / 1000)
    pages[6].keyboard.press("Escape")
    pages[6].keyboard.press("Escape")
    for page in pages:
        require_arrived(page)


@pytest.mark.parametrize("phone", [False, True])
def test_where_a_stop_cannot_arrive_the_page_says_so_within_two_seconds_and_stop_stays_in_reach(
    context: BrowserContext, studio: Served, work: Work, phone: bool
) -> None:
    says = "The stop has not arrived yet" if phone else "emergency stop at the robot"
    if not phone:  # a machine that can hurt somebody
        context.route("**/api/studio", lambda route: route.fulfill(json={**route.fetch().json(), "dangerous": True}))
    page = enter(context, studio)
    page.set_viewport_size({"width": 390, "height": 844} if phone else {"width": 1440, "height": 900})
    page.route("**/stop", lambda route: None)  # it is never answered
    page.clock.install()  # the page's own time, whatever else the machine does
    page.clock.pause_at(datetime.now() + timedelta(hours=1))
    stop(page)
    page.clock.run_for(1000)
    assert page.locator(".stop-alarm").is_hidden()
    page.clock.run_for(1000)
    expect(page.locator(".stop-alarm")).to_contain_text(says)
    page.screenshot(path=SCREENSHOTS / f"stop-did-not-arrive-{'phone' if phone else 'desk'}.png")
    for view in ("#/", "#/new", "#/calibrate"):
        page.evaluate("view => { location.hash = view; }", view)
        assert_stop_is_on_top(page)
    page.unroute("**/stop")
    page.clock.resume()
    assert work.told.wait(WAIT / 1000), "it is sent again"
    expect(page.locator(".stop-alarm")).to_contain_text("The stop arrived after", timeout=WAIT)
    page.get_by_role("button", name="Close" if phone else "I have looked at the robot", exact=True).last.click()
    expect(page.locator(".stop-alarm")).to_be_hidden()


def assert_stop_is_on_top(page: Page) -> None:
    """Nothing lies over Stop, at any of its corners."""
    box = page.locator("#stop").bounding_box()
    assert box is not None
    for across in (0.15, 0.5, 0.85):
        for down in (0.15, 0.5, 0.85):
            place = [box["x"] + across * box["width"], box["y"] + down * box["height"]]
            assert page.evaluate("([x, y]) => document.elementFromPoint(x, y)?.id", place) == "stop"


def test_an_alarm_ends_by_itself_when_the_studio_is_back_and_nothing_can_move(
    context: BrowserContext, studio: Served
) -> None:
    page = enter(context, studio)
    context.set_offline(True)
    stop(page)
    alarm = page.locator(".stop-alarm")
    expect(alarm).to_contain_text("has not arrived yet", timeout=WAIT)
    assert_stop_is_on_top(page)
    page.evaluate("location.hash = '#/new'")
    expect(alarm).to_be_visible()
    context.set_offline(False)
    expect(alarm).to_be_hidden(timeout=WAIT)
    require_arrived(page)


def test_an_alarm_of_a_machine_that_may_have_moved_is_ended_by_a_person_alone(
    context: BrowserContext, studio: Served
) -> None:
    context.route("**/api/studio", lambda route: route.fulfill(json={**route.fetch().json(), "dangerous": True}))
    working = Work(PaintingStore(studio.folder))
    page = enter(context, studio)
    page.route("**/stop", lambda route: route.fulfill(json={"stopped": 1, "heard": 0}))
    stop(page)
    alarm = page.locator(".stop-alarm")
    expect(alarm).to_contain_text("If the robot moves, use its emergency stop", timeout=WAIT)
    with page.expect_response("**/api/work"):
        pass
    working.lock.release()
    for _ in range(3):
        with page.expect_response("**/api/work"):
            pass
    expect(alarm).to_be_visible()
    page.get_by_role("button", name="I have looked at the robot").click()
    expect(alarm).to_be_hidden()


def test_an_alarm_that_nobody_confirmed_ends_when_nobody_is_at_work_any_more(
    context: BrowserContext, studio: Served
) -> None:
    working = Work(PaintingStore(studio.folder))
    page = enter(context, studio)
    page.route("**/stop", lambda route: route.fulfill(json={"stopped": 1, "heard": 0}))
    stop(page)
    alarm = page.locator(".stop-alarm")
    expect(alarm).to_contain_text("has not confirmed it", timeout=WAIT)
    with page.expect_response("**/api/work"), page.expect_response("**/api/work"):
        pass
    expect(alarm).to_contain_text("has not confirmed it")
    working.lock.release()
    expect(page.get_by_text("Everything has stopped.")).to_be_visible(timeout=WAIT)
    expect(alarm).to_be_hidden(timeout=WAIT)


@pytest.mark.parametrize("heard", [True, False], ids=["connected", "connecting"])
def test_an_old_page_stops_though_the_studio_does_not_know_it_any_more(
    context: BrowserContext, studio: Served, work: Work, heard: bool
) -> None:
    page = enter(context, studio, f"#/p/{work.entry.id}")
    if heard:
        Feed(work.folder).tell(Failed("The first is told"))
        expect(page.get_by_text("The first is told")).to_be_visible(timeout=WAIT)
    studio.kill()
    again = open_studio(studio.folder, port=studio.port)
    try:
        if heard:
            expect(page.get_by_text("open the link that its terminal shows")).to_be_visible(timeout=WAIT)
        stop(page)
        assert work.told.wait(WAIT / 1000)
        require_arrived(page)
    finally:
        again.kill()


@pytest.mark.parametrize("phone", [False, True])
def test_after_a_restart_a_reload_says_how_to_come_in_again_and_stops(
    context: BrowserContext, studio: Served, work: Work, phone: bool
) -> None:
    page = enter(context, studio, f"#/p/{work.entry.id}")
    page.set_viewport_size({"width": 390, "height": 844} if phone else {"width": 1440, "height": 900})
    page.evaluate("navigator.serviceWorker.ready.then(() => {})")
    name = "phone" if phone else "desk"
    studio.kill()
    page.reload()  # nobody answers; the page's service worker has kept a page for that
    expect(page.get_by_role("heading", name="The studio does not answer")).to_be_visible(timeout=WAIT)
    page.screenshot(path=SCREENSHOTS / f"closed-away-{name}.png")
    assert_stop_is_on_top(page)
    again = open_studio(studio.folder, port=studio.port)
    try:
        expect(page.get_by_role("heading", name="Open the studio with its link")).to_be_visible(timeout=WAIT)
        expect(page.get_by_text("frida-painter studio --link")).to_be_visible()
        style = page.evaluate("getComputedStyle(document.querySelector('.bar')).position")
        assert style == "sticky", "it has its style"
        assert page.evaluate("document.documentElement.scrollWidth") <= page.viewport_size["width"]  # type: ignore[index]
        page.screenshot(path=SCREENSHOTS / f"closed-unknown-{name}.png")
        stop(page)
        assert work.told.wait(WAIT / 1000)
        expect(
            page.get_by_text("The stop has arrived.").or_(page.get_by_text("The stop arrived after"))
        ).to_be_visible()
    finally:
        again.kill()


def test_a_browser_that_was_never_here_is_told_how_to_come_in_and_where_to_stop(
    context: BrowserContext, studio: Served
) -> None:
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


def test_a_server_on_another_port_is_sent_the_cookie_and_can_do_nothing_with_it(
    context: BrowserContext, studio: Served, work: Work
) -> None:
    enter(context, studio)
    with _neighbour(studio.host) as address:
        page = context.new_page()
        page.goto(address)
        assert page.evaluate("localStorage.length") == 0
    cookie = next(filter(None, _Neighbour.cookies))
    for method, path in (
        ("GET", "/api/studio"),
        ("GET", "/api/paintings"),
        ("POST", "/api/lead"),
        ("POST", "/api/stop"),
    ):
        connection = HTTPConnection(studio.host, studio.port, timeout=30)
        with contextlib.closing(connection):
            origin = f"http://{studio.host}:{studio.port}"
            connection.request(method, path, headers={"Cookie": cookie, "Origin": origin, "X-Page-Key": ""})
            assert connection.getresponse().status == 403
    assert not work.told.is_set()


def test_a_link_on_another_page_opens_the_studio(context: BrowserContext, studio: Served) -> None:
    page, address = context.new_page(), f"http://{studio.host}:{studio.port}/"
    # By a server: a page that the test would answer for itself makes the browser tell less of where a click came from.
    with _neighbour("localhost") as elsewhere:
        for way in (f"{address}?token={studio.tokens['operate']}", address):
            _Neighbour.link = way
            page.goto(elsewhere)
            page.get_by_text("Come").click()
            expect(page.get_by_role("button", name="Stop", exact=True)).to_be_visible(timeout=WAIT)
