import itertools
import re
import time
from pathlib import Path

import pytest
from starlette.websockets import WebSocketDisconnect

import frida_painter_studio as web
from frida_painter_studio import security
from frida_painter_studio.commands import Role
from frida_painter_studio.security import Keys
from frida_painter_studio.store import PaintingStore
from frida_painter_studio.workers import WorkerSlot
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
    for _ in range(250):
        assert keys.session(first.id) is first, "whoever is here is used, and stays"
        assert keys.admit(keys.tokens[Role.watch]) is not None
    assert len(keys.sessions) == 202
    assert keys.session(operator.id) is operator and keys.session(planner.id) is planner


def test_a_cookie_that_another_port_was_sent_opens_nothing(studio: Studio) -> None:
    """A browser sends its cookies to every port of a host; only the page's own address and port has the key."""
    visitor = studio.visitor()
    entry = studio.store.begin("A painting")
    for path in ("/api/studio", "/api/paintings", f"/api/paintings/{entry.id}", "/api/events?of=calibration"):
        assert visitor.client.get(path).status_code == 403
    for path in ("/api/stop", "/api/lead", "/api/pictures"):
        assert visitor.client.post(path, headers={"Origin": ORIGIN, **order()}).status_code == 403
    assert visitor.key not in visitor.client.get("/").text
    assert visitor.client.get("/static/main.js").status_code == 200


def test_headers_that_are_too_large_are_refused(studio: Studio) -> None:
    assert studio.visitor().get("/api/studio", headers={"X-More": "x" * 100_000}).status_code == 431


HOSTS = ["evil.example:8350", "127.0.0.1", "127.0.0.1:80", "127.0.0.1:8350.evil.example", ""]


def test_other_names_for_this_machine_are_refused(studio: Studio) -> None:
    visitor = studio.visitor()
    for host in HOSTS:
        assert visitor.get("/api/studio", headers={"Host": host}).status_code == 403
        assert visitor.post("/api/stop", headers={"Host": host, "Origin": f"http://{host}"}).status_code == 403
        token = studio.keys.tokens[Role.operate]
        assert studio.client().get("/", params={"token": token}, headers={"Host": host}).status_code == 403


def test_what_another_page_sends_is_refused(studio: Studio) -> None:
    visitor = studio.visitor()
    others = ["https://127.0.0.1:8350", "http://127.0.0.1:8351", "http://localhost:8350", f"{ORIGIN}/"]
    for origin in ("http://evil.example", "null", "", *others):
        assert visitor.post("/api/stop", headers={"Origin": origin}).status_code == 403, origin


def test_a_cookie_alone_changes_nothing(studio: Studio) -> None:
    visitor = studio.visitor()
    assert visitor.client.post("/api/stop").status_code == 403, "no origin"
    assert visitor.client.post("/api/stop", headers={"Origin": ORIGIN}).status_code == 403, "no sign"
    other = studio.visitor()
    assert visitor.post("/api/stop", headers={"X-Page-Key": other.key}).status_code == 403, "of another browser"
    assert visitor.post("/api/stop").status_code == 200


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
    assert not entry.folder.inbox.exists() and not entry.folder.stop.exists()


def test_a_program_brings_its_token_and_needs_no_origin(studio: Studio) -> None:
    headers = {"Authorization": f"Bearer {studio.keys.tokens[Role.operate]}"}
    assert studio.client().post("/api/stop", headers=headers).status_code == 200
    assert studio.client().post("/api/stop", headers={**headers, "Origin": "http://evil.example"}).status_code == 403


def test_pictures_cannot_be_shown_on_other_pages(studio: Studio) -> None:
    visitor = studio.visitor()
    for site, status in (("cross-site", 403), ("same-site", 403), ("same-origin", 200)):
        assert visitor.get("/api/paintings", headers={"Sec-Fetch-Site": site}).status_code == status


def test_who_may_only_watch_may_stop_but_neither_plan_nor_start(studio: Studio) -> None:
    entry = studio.store.begin("A painting")
    watching, planning = studio.visitor(Role.watch), studio.visitor(Role.plan)
    assert watching.post("/api/stop").status_code == 200
    assert watching.post("/api/pictures", content=b"x").status_code == 403
    assert watching.post("/api/paintings", json={"terms": []}).status_code == 403
    for visitor in (watching, planning):
        start = visitor.post(f"/api/paintings/{entry.id}/start", json={"plan": 1, "ready": True})
        assert start.status_code == 403 and "another link" in start.json()["sentence"]
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
