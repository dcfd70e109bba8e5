import itertools
import math
import os
import re
import time
from contextlib import suppress
from pathlib import Path

import pytest
from starlette.websockets import WebSocketDisconnect

import frida_painter_studio as web
from frida_painter.errors import Interrupted, RobotStopped
from frida_painter_studio import security
from frida_painter_studio.security import Keys, Lead, Led, Presence
from frida_painter_studio.store import PaintingStore
from frida_painter_studio.web_app_easel import WebAppEasel
from frida_painter_studio.workers import WorkerSlot
from frida_painter_together.commands import Role
from support.studio import HOST, ORIGIN, Studio, order

ROUTES = [
    ("GET", "/"), ("GET", "/static/main.js"), ("GET", "/static/nothing"), ("GET", "/api/studio"),
    ("GET", "/api/paintings"),
    ("GET", "/api/paintings/0123456789abcdef"), ("GET", "/api/events?of=calibration"),
    ("GET", "/paintings/0123456789abcdef/live/a.jpg"), ("POST", "/api/stop"), ("POST", "/api/pictures"),
    ("POST", "/api/paintings"), ("POST", "/api/paintings/0123456789abcdef/start"), 
    ("GET", "/openapi.json"), ("GET", "/docs"),
    ("PUT", "/"), ("DELETE", "/api/paintings"), ("OPTIONS", "/api/stop"),
]  # fmt: skip


@pytest.fixture
def studio(tmp_path: Path) -> Studio:
    return Studio(tmp_path / "store")


def test_without_the_token_nothing_is_had(studio: Studio, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(security, "_DELAY", 0.0)
    client = studio.client()
    strangers: list[dict[str, str | bytes]] = [
        {},
        {"Cookie": "studio-8350=guess"},
        {"Cookie": "studio-8350"},
        {"Cookie": 'studio-8350="; x=\x7f'},
        {"Authorization": "Bearer guess"},
        {"Authorization": "Bearer "},
        {"Authorization": "Bearer größer".encode()},
    ]
    for headers, (method, path) in itertools.product(strangers, ROUTES):
        answer = client.request(method, path, headers=headers)  # type: ignore[arg-type]
        assert answer.status_code == 401, (headers, method, path)
        assert "set-cookie" not in answer.headers


def test_a_stranger_is_told_how_to_come_in_and_gets_no_file_but_those_of_that_page(studio: Studio) -> None:
    client = studio.client()
    for path in ("/", "/?token=guess"):
        closed = client.get(path, headers={"Accept": "text/html"})
        assert closed.status_code == 401 and "frida-painter studio --link" in closed.text
        assert str(studio.store.root) not in closed.text and "set-cookie" not in closed.headers
    static, needed = Path(web.__file__).parent / "static", {"/static/session.js"}  # stop.js imports it
    needed |= set(re.findall(r'(?:src|href)="(/static/[^"]+)"', closed.text))
    needed |= {f"/static/{name}" for name in re.findall(r'from "./([^"]+)"', (static / "closed.js").read_text())}
    given = {
        f"/static/{file.name}" for file in static.iterdir() if client.get(f"/static/{file.name}").status_code == 200
    }
    assert given == needed
    for path in needed:
        assert client.get(path, headers={"Sec-Fetch-Site": "cross-site"}).status_code == 403


def test_the_token_is_taken_out_of_the_address_and_becomes_a_cookie_that_no_script_reads(studio: Studio) -> None:
    client = studio.client()
    entered = client.get("/", params={"token": studio.keys.tokens[Role.watch], "view": "gallery"})
    assert entered.status_code == 200 and 'content="0;url=/?view=gallery#key=' in entered.text
    cookie = entered.headers["set-cookie"].lower()
    assert "httponly" in cookie and "samesite=strict" in cookie
    assert studio.keys.tokens[Role.watch] not in entered.text + str(entered.headers)
    assert client.get("/").status_code == 200


def test_every_start_has_new_tokens_and_every_role_its_own() -> None:
    first, second = Keys(), Keys()
    tokens = [*first.tokens.values(), *second.tokens.values()]
    assert len(set(tokens)) == 6 and all(len(token) >= 32 for token in tokens)


@pytest.mark.parametrize("bearer", [False, True])
def test_wrong_tokens_are_slowed_and_lock_nobody_out_who_has_the_right_one(
    studio: Studio, monkeypatch: pytest.MonkeyPatch, bearer: bool
) -> None:
    monkeypatch.setattr(security, "_DELAY", 0.3)
    client = studio.client()

    def come(token: str) -> int:
        if bearer:
            return client.get("/api/studio", headers={"Authorization": f"Bearer {token}"}).status_code
        return client.get("/", params={"token": token}).status_code

    assert {come(f"guess {number}") for number in range(10)} == {401}
    began = time.monotonic()
    assert come("guess") == 401 and time.monotonic() - began >= 0.3
    monkeypatch.setattr(security, "_MAX_DELAYED", 0)
    assert come("guess") == 429
    assert come(studio.keys.tokens[Role.operate]) == 200


def test_what_another_page_loads_is_refused_before_its_token_is_looked_at(studio: Studio) -> None:
    client, right = studio.client(), studio.keys.tokens[Role.operate]
    for mode, aim in (("no-cors", "image"), ("navigate", "iframe"), ("cors", "empty")):
        signs = {"Sec-Fetch-Site": "cross-site", "Sec-Fetch-Mode": mode, "Sec-Fetch-Dest": aim}
        for token in (*["guess"] * 11, right):
            assert client.get("/", params={"token": token}, headers=signs).status_code == 403
    assert client.get("/", params={"token": right}).status_code == 200


@pytest.mark.parametrize("aim", ["document", "empty"])
def test_a_link_that_was_clicked_on_another_page_opens_the_studio(studio: Studio, aim: str) -> None:
    clicked = {"Sec-Fetch-Site": "cross-site", "Sec-Fetch-Mode": "navigate", "Sec-Fetch-Dest": aim}
    client = studio.client()
    assert client.get("/", headers=clicked).status_code == 200, "the browser may keep its cookie back: go on from here"
    assert client.get("/", headers={"Accept": "text/html"}).status_code == 401
    for _ in range(30):
        assert client.get("/", params={"token": "guess"}, headers=clicked).status_code == 401
    entered = client.get("/", params={"token": studio.keys.tokens[Role.watch]}, headers=clicked)
    assert entered.status_code == 200 and "set-cookie" in entered.headers
    assert client.get("/api/paintings", headers=clicked).status_code == 403


def test_a_link_for_a_browsers_command_line_is_good_once_and_for_a_minute(monkeypatch: pytest.MonkeyPatch) -> None:
    keys = Keys()
    once, late = keys.code(Role.operate), keys.code(Role.operate)
    session = keys.admit(once)
    assert session is not None and session.role is Role.operate and keys.admit(once) is None
    assert keys.bearer(late) is None
    now = time.monotonic()
    monkeypatch.setattr(time, "monotonic", lambda: now + 61)
    assert keys.admit(late) is None


def test_those_who_watch_take_no_session_from_those_who_paint() -> None:
    keys = Keys()
    operator, planner = keys.admit(keys.tokens[Role.operate]), keys.admit(keys.tokens[Role.plan])
    first = keys.admit(keys.tokens[Role.watch])
    assert operator is not None and planner is not None and first is not None
    second = keys.admit(keys.tokens[Role.watch])
    assert second is not None
    for _ in range(250):
        assert keys.session(first.id) is first, "whoever is here is used, and stays"
        assert keys.admit(keys.tokens[Role.watch]) is not None
    assert keys.session(second.id) is None, "there are only so many sessions of a role"
    assert keys.session(operator.id) is operator and keys.session(planner.id) is planner


BEARER, EVIL = "Bearer {operate}", "http://evil.example"
OTHERS = (EVIL, "null", "", "https://127.0.0.1:8350", "http://127.0.0.1:8351", "http://localhost:8350", f"{ORIGIN}/")
HOSTS = ("evil.example:8350", "127.0.0.1", "127.0.0.1:80", "127.0.0.1:8350.evil.example", "")
SITES = (("cross-site", 403), ("same-site", 403), ("same-origin", 200))
REQUESTS: list[tuple[str, str, str, dict[str, str], int]] = [
    # who asks: the browser's page, its cookie alone, or a program with a token; then how, what, with which headers
    *(("cookie", "GET", path, {}, 403) for path in ("studio", "paintings/{known}", "events?of=calibration")),
    *(("cookie", "POST", path, {"Origin": ORIGIN}, 403) for path in ("stop", "lead", "pictures")),
    ("cookie", "POST", "stop", {}, 403),
    ("page", "POST", "stop", {}, 200),
    ("page", "POST", "stop", {"X-Page-Key": "{other}"}, 403),
    *(("page", "POST", "stop", {"Origin": origin}, 403) for origin in OTHERS),
    *(("page", "GET", "studio", {"Host": host}, 403) for host in HOSTS),
    *(("page", "POST", "stop", {"Host": host, "Origin": f"http://{host}"}, 403) for host in HOSTS),
    *(("page", "GET", "paintings", {"Sec-Fetch-Site": site}, status) for site, status in SITES),
    ("page", "GET", "studio", {"X-More": "x" * 100_000}, 431),
    ("program", "POST", "stop", {"Authorization": BEARER}, 200),
    ("program", "POST", "stop", {"Authorization": BEARER, "Origin": EVIL}, 403),
]  # fmt: skip


def test_a_request_is_done_only_for_a_page_of_this_very_address_or_a_program_with_a_token(studio: Studio) -> None:
    """A browser sends its cookies to every port of a host; only the page's own address and port has the key."""
    visitor, known = studio.visitor(), studio.store.begin("A painting").id
    words = {"operate": studio.keys.tokens[Role.operate], "other": studio.visitor().key, "known": known}
    ways = {
        ("page", "GET"): visitor.get, ("page", "POST"): visitor.post,
        ("cookie", "GET"): visitor.client.get, ("cookie", "POST"): visitor.client.post,
        ("program", "POST"): studio.client().post,
    }  # fmt: skip
    for who, method, path, headers, status in REQUESTS:
        given = {name: value.format(**words) for name, value in headers.items()}
        answer = ways[who, method](f"/api/{path.format(**words)}", headers={**order(), **given})
        assert answer.status_code == status, (who, method, path, headers)
    for host in HOSTS:
        query = {"token": studio.keys.tokens[Role.operate]}
        assert studio.client().get("/", params=query, headers={"Host": host}).status_code == 403
    assert visitor.key not in visitor.client.get("/").text
    assert visitor.client.get("/static/main.js").status_code == 200


def test_nothing_that_is_asked_with_get_moves_or_changes_anything(
    studio: Studio, monkeypatch: pytest.MonkeyPatch
) -> None:
    started: list[str] = []
    monkeypatch.setattr(WorkerSlot, "start", lambda self, job, plan: started.append(job))
    monkeypatch.setattr(PaintingStore, "note", lambda self, by, painting, what: started.append(what))
    entry, visitor = studio.store.begin("A painting"), studio.visitor()
    described = studio.app.openapi()["paths"]
    assert {method for own in described.values() for method in own} == {"get", "post"}
    for path in described:
        if not path.endswith("/events"):  # these never end
            visitor.get(path.replace("{identifier}", entry.id).replace("{picture}", "0" * 32))
    assert started == [] and studio.store.find(entry.id) is not None
    assert not (entry.folder.painting / "inbox.jsonl").exists() and not entry.folder.stop.exists()


def test_who_may_only_watch_may_stop_but_neither_plan_nor_start(studio: Studio) -> None:
    entry = studio.store.begin("A painting")
    watching, planning = studio.visitor(Role.watch), studio.visitor(Role.plan)
    assert watching.post("/api/stop").status_code == 200
    assert watching.post("/api/pictures", content=b"x").status_code == 403
    assert watching.post("/api/paintings", json={"terms": []}).status_code == 403
    for visitor, says in ((watching, "you may watch here"), (planning, "you may plan here, and not move the robot")):
        start = visitor.post(f"/api/paintings/{entry.id}/start", json={"plan": 1, "ready": True})
        assert start.status_code == 403 and says in start.json()["sentence"]
        assert visitor.post(f"/api/paintings/{entry.id}/delete").status_code == 403
    assert planning.post("/api/pictures", content=b"x").status_code == 422


def test_every_answer_carries_safe_headers(studio: Studio) -> None:
    visitor = studio.visitor()
    for answer in (visitor.get("/"), visitor.get("/nothing"), studio.client().get("/"), visitor.get("/static/main.js")):
        assert answer.headers["content-security-policy"].startswith("default-src 'self';")
        assert answer.headers["x-content-type-options"] == "nosniff"
        assert answer.headers["x-frame-options"] == "DENY"
        assert answer.headers["referrer-policy"] == "no-referrer"
        assert "server" not in answer.headers


def test_there_are_no_websockets(studio: Studio) -> None:
    visitor = studio.visitor()
    with pytest.raises(WebSocketDisconnect) as caught, visitor.client.websocket_connect(f"ws://{HOST}/"):
        pass
    assert caught.value.code == 1008


# Presence of a person beside the machine.


@pytest.mark.parametrize("robot", ["xarm:10.0.0.1", "axidraw"])
def test_a_real_robot_moves_only_after_a_press_and_each_press_is_good_for_one_thing_and_a_minute(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, robot: str
) -> None:
    presence, easel = Presence(possible=True), WebAppEasel(tmp_path / "record.json", robot)
    presence.allow(WebAppEasel(tmp_path / "record.json"))  # a simulated robot needs nobody
    with pytest.raises(RobotStopped, match="press Enter"):
        presence.allow(easel)
    presence.press()
    presence.allow(easel)
    with pytest.raises(RobotStopped):
        presence.allow(easel)
    presence.press()
    now = time.monotonic()
    monkeypatch.setattr(time, "monotonic", lambda: now + security.GOOD_FOR + 1)
    presence.possible = False
    with pytest.raises(RobotStopped, match="in a terminal"):
        presence.allow(easel)


def test_presses_are_heard_from_the_terminal(capsys: pytest.CaptureFixture[str]) -> None:
    presence = Presence()
    read, write = os.pipe()
    presence.listen(read)
    os.write(write, b"\n")
    deadline = time.monotonic() + 10
    assert presence.possible
    while time.monotonic() < deadline:
        with suppress(RobotStopped):
            presence.require()
            break
        time.sleep(0.01)
    with pytest.raises(RobotStopped, match="press Enter"):
        presence.require()
    os.close(write)
    while presence.possible and time.monotonic() < deadline:
        time.sleep(0.01)
    assert not presence.possible
    os.close(read)


# Lead of one browser at a time.

NONCE = "0123456789abcdef"


def test_one_browser_leads_until_another_takes_over() -> None:
    lead = Lead()
    lead.require("one", NONCE + "1", time.time())
    lead.require("one", NONCE + "2", time.time())
    with pytest.raises(Led, match="Another browser leads"):
        lead.require("two", NONCE + "3", time.time())
    lead.take_over("two", NONCE + "5", time.time())
    with pytest.raises(Interrupted, match="already"):
        lead.take_over("one", NONCE + "5", time.time())
    lead.require("two", NONCE + "3", time.time())
    with pytest.raises(Led):
        lead.require("one", NONCE + "4", time.time())


def test_whoever_asks_for_nothing_any_more_leads_no_longer(monkeypatch: pytest.MonkeyPatch) -> None:
    lead = Lead()
    lead.require("one", NONCE + "1", time.time())
    now = time.monotonic()
    monkeypatch.setattr(time, "monotonic", lambda: now + security.KEPT_FOR + 1)
    lead.require("two", NONCE + "2", time.time())


def test_a_page_that_is_left_gives_the_lead_back_and_no_other_page_can() -> None:
    lead = Lead()
    lead.require("one", NONCE + "1", time.time(), "first page")
    assert not lead.give_back("two", "first page") and not lead.give_back("one", "another page")
    with pytest.raises(Led):
        lead.require("two", NONCE + "2", time.time(), "page of two")
    assert lead.give_back("one", "first page") and not lead.give_back("one", "first page")
    lead.require("one", NONCE + "3", time.time(), "reloaded")
    assert not lead.give_back("one", "first page"), "the page before the reload says so late"
    with pytest.raises(Led):
        lead.require("two", NONCE + "4", time.time(), "page of two")
    assert lead.give_back("one", "reloaded")
    lead.require("two", NONCE + "4", time.time(), "page of two")


@pytest.mark.parametrize(
    ("nonce", "late", "says"),
    [
        ("short", 0.0, "reload"), ("x" * 65, 0.0, "reload"), (NONCE, math.nan, "reload"), (NONCE, math.inf, "reload"),
        (NONCE, 11.0, "too long ago"), (NONCE, -11.0, "too long ago"),
    ],
)  # fmt: skip
def test_orders_that_are_old_or_nameless_are_refused(nonce: str, late: float, says: str) -> None:
    with pytest.raises(Interrupted, match=says):
        Lead().require("one", nonce, time.time() - late)


def test_each_order_is_done_once() -> None:
    lead = Lead()
    lead.require("one", NONCE, time.time())
    with pytest.raises(Interrupted, match="already"):
        lead.require("one", NONCE, time.time())
