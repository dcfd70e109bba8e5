import hashlib
import io
import os
import re
import shutil
import sqlite3
import time
import zipfile
from collections.abc import Callable
from contextlib import closing
from datetime import datetime
from pathlib import Path
from typing import Any

import pytest
from fastapi.testclient import TestClient
from PIL import Image

import frida_painter_studio as web
from frida_painter import registry
from frida_painter.hardware.latch import Latch, latch_path
from frida_painter.registry import VARIABLE
from frida_painter.runs.variant_settings import VARIANTS
from frida_painter.session.events import ResultFound, Stopped, StrokePainted
from frida_painter.session.journal import Journal
from frida_painter.system import locks
from frida_painter_studio.routes import SentFile, zip_folder
from frida_painter_studio.store import Entry
from frida_painter_studio.web_app_easel import WebAppEasel
from frida_painter_studio.workers import PaintingQueue, Workers, WorkerSlot
from frida_painter_together.commands import Role
from frida_painter_together.inbox import Inbox
from plugins import install
from support.studio import Studio, Visitor, locked

PICTURE = "a" * 32


def with_picture(studio: Studio) -> Studio:
    Image.new("RGB", (64, 48), (200, 120, 60)).save(studio.store.pictures / f"{PICTURE}.png")
    return studio


@pytest.fixture
def studio(tmp_path: Path) -> Studio:
    return with_picture(Studio(tmp_path / "store"))


@pytest.fixture
def visitor(studio: Studio) -> Visitor:
    return studio.visitor()


@pytest.fixture
def started(monkeypatch: pytest.MonkeyPatch) -> list[tuple[str, int]]:
    """What would have been started, by job and number of the plan; nobody is really at work."""
    jobs: list[tuple[str, int]] = []
    monkeypatch.setattr(WorkerSlot, "start", lambda self, job, plan: jobs.append((job, plan.number)))
    return jobs


def wait_for(holds: Callable[[], bool]) -> None:
    """Until it holds; fails where it does not come to that."""
    deadline = time.monotonic() + 10
    while not holds():
        assert time.monotonic() < deadline
        time.sleep(0.02)


def painting_request(picture: str = PICTURE, **more: Any) -> dict[str, Any]:
    return {"title": "Tea", "terms": [{"kind": "image", "picture": picture}], "strokes": 5, "colors": 2, **more}


def begun(studio: Studio, visitor: Visitor) -> Entry:
    identifier = visitor.post("/api/paintings", json=painting_request()).json()["id"]
    entry = studio.store.find(identifier)
    assert entry is not None
    return entry


def audit_records(studio: Studio) -> list[str]:
    """What was asked for, in order."""
    with closing(sqlite3.connect(studio.store.root / "studio.sqlite")) as base:
        return [what for (what,) in base.execute("SELECT what FROM deed ORDER BY rowid")]


def finish_plan(entry: Entry) -> None:
    entry.folder.plan(1).plan.write_text("{}")


def start_painting(visitor: Visitor, entry: Entry) -> Entry:
    finish_plan(entry)
    assert visitor.post(f"/api/paintings/{entry.id}/start", json={"plan": 1, "ready": True}).status_code == 200
    entry.folder.painting.mkdir()
    (entry.folder.painting / "journal").write_text("")
    return entry


def test_the_page_and_all_that_it_needs_come_from_here(visitor: Visitor) -> None:
    page = visitor.get("/")
    assert page.status_code == 200 and "http" not in page.text.replace("http-equiv", "")
    assert "style=" not in page.text and "<script>" not in page.text
    static = Path(web.__file__).parent / "static"
    for file in static.iterdir():
        late = (
            file.suffix == ".js"
            and file.name not in ("sw.js", "stream-worker.js", "closed.js")
            and f"/static/{file.name}" not in page.text
        )
        assert not late, f"{file.name} is fetched late"
        answer = visitor.get(f"/static/{file.name}")
        assert answer.status_code == 200 and answer.content == file.read_bytes()
        assert "http" not in answer.text.replace("http://www.w3.org/2000/svg", ""), f"{file.name} asks somebody else"


def test_the_page_weighs_little(visitor: Visitor) -> None:
    names = [file.name for file in (Path(web.__file__).parent / "static").iterdir()]
    sent = {name: int(visitor.get(f"/static/{name}").headers["content-length"]) for name in names}
    assert sum(sent.values()) <= 114_000, sent
    plain = visitor.get("/static/main.js", headers={"Accept-Encoding": "identity"})
    assert "content-encoding" not in plain.headers and plain.text == visitor.get("/static/main.js").text


def test_the_examples_of_an_empty_gallery_are_small_and_each_comes_with_its_goal(visitor: Visitor) -> None:
    folder = Path(web.__file__).parent / "examples"
    named = re.findall(r'name: "([a-z]+)"', (folder.parent / "static/examples.js").read_text())
    assert len(named) == 3
    for name in (f"{name}{part}.jpg" for name in named for part in ("", "-goal")):
        picture = visitor.get(f"/examples/{name}")
        assert picture.headers["content-type"] == "image/jpeg" and len(picture.content) < 60_000
        assert f"`{name}`" in (folder / "README.md").read_text() or "-goal" not in name, "its licence is told"
    assert visitor.get("/examples/README.md").status_code == 404


def test_what_the_page_takes_from_others_is_as_they_published_it() -> None:
    static = Path(web.__file__).parent / "static"
    notice, _, module = (static / "perfect-freehand.js").read_bytes().partition(b"*/\n")
    assert b"1.2.3" in notice and b"Permission is hereby granted" in notice
    published = "a02e221f71a757e46915a51d8f5ffc8d1788d9134e063b3edd21f429c973d46c"  # dist/esm/index.mjs of that version
    assert hashlib.sha256(module).hexdigest() == published


def test_the_page_can_be_installed(visitor: Visitor) -> None:
    manifest = visitor.get("/static/manifest.webmanifest")
    assert manifest.headers["content-type"].startswith("application/manifest+json")
    for icon in manifest.json()["icons"]:
        assert visitor.get(icon["src"]).headers["content-type"].startswith(icon["type"])
    assert visitor.get("/sw.js").headers["content-type"].startswith("text/javascript")
    assert visitor.get("/static/closed.html").status_code == 200


def test_a_picture_is_taken_and_given_back(visitor: Visitor) -> None:
    file = io.BytesIO()
    Image.new("RGB", (64, 48), (200, 120, 60)).save(file, "PNG")
    answer = visitor.get(f"/api/pictures/{visitor.post('/api/pictures', content=file.getvalue()).json()['id']}")
    assert answer.headers["content-type"] == "image/png" and answer.headers["content-disposition"] == "attachment"
    assert visitor.get("/api/pictures/" + "0" * 32).status_code == 404


def test_a_painting_begins_with_a_plan(studio: Studio, visitor: Visitor, started: list[tuple[str, int]]) -> None:
    entry = begun(studio, visitor)
    assert started == [("plan", 1)]
    state = visitor.get(f"/api/paintings/{entry.id}").json()
    assert state["title"] == "Tea" and state["plans"][0]["wish"]["strokes"] == 5
    assert visitor.post(f"/api/paintings/{entry.id}/plans", json=painting_request(PICTURE, seed=7)).status_code == 200
    assert started == [("plan", 1), ("plan", 2)]
    assert [plan["wish"]["seed"] for plan in visitor.get(f"/api/paintings/{entry.id}").json()["plans"]] == [0, 7]
    gallery = visitor.get("/api/paintings").json()
    assert [(each["title"], each["picture"]) for each in gallery] == [("Tea", None)]


def test_variants_are_ordered_together_and_only_a_finished_one_is_painted(
    studio: Studio, visitor: Visitor, started: list[tuple[str, int]]
) -> None:
    entry = begun(studio, visitor)
    path = f"/api/paintings/{entry.id}"
    assert visitor.post(f"{path}/plans?variants=true", json=painting_request()).status_code == 200
    plans = visitor.get(path).json()["plans"]
    assert [plan["wish"]["variant"] for plan in plans] == ["", *VARIANTS] and started == [("plan", 1), ("plan", 2)]
    assert [plan["beside"] for plan in plans] == [False, False, True, True]
    entry.folder.plan(3).plan.write_text("{}")
    for number, status in ((2, 422), (4, 422), (99, 422), (3, 200)):
        assert visitor.post(f"{path}/start", json={"plan": number, "ready": True}).status_code == status
    assert started[-1] == ("paint", 3)
    for number in range(5, 23):
        entry.folder.plan(number).path.mkdir()
    full = visitor.post(f"{path}/plans?variants=true", json=painting_request())
    assert full.status_code == 422 and len(entry.folder.plans()) == 22, "all three or none"
    together = visitor.post("/api/paintings?variants=true", json={"together": True})
    assert together.status_code == 422 and "no variants" in together.json()["sentence"]


def test_the_robot_starts_only_when_the_person_says_that_all_is_ready(
    studio: Studio, visitor: Visitor, started: list[tuple[str, int]]
) -> None:
    entry = begun(studio, visitor)
    path = f"/api/paintings/{entry.id}/start"
    assert "not finished" in visitor.post(path, json={"plan": 1, "ready": True}).json()["sentence"]
    finish_plan(entry)
    assert "ready" in visitor.post(path, json={"plan": 1, "ready": False}).json()["sentence"]
    with locked(entry.folder):  # two clicks at once start one painter
        answer = visitor.post(path, json={"plan": 1, "ready": True})
        assert answer.status_code == 409 and "already" in answer.json()["sentence"]
        assert visitor.post(f"/api/paintings/{entry.id}/delete").status_code == 409
    assert visitor.post(path, json={"plan": 1, "ready": True}).status_code == 200
    assert started == [("plan", 1), ("paint", 1)]
    entry.folder.painting.mkdir()
    again = visitor.post(path, json={"plan": 1, "ready": True})
    assert again.status_code == 409 and "begun already" in again.json()["sentence"]


def test_stop_reaches_those_who_work_and_is_put_down(studio: Studio, visitor: Visitor, started: Any) -> None:
    entry, other = begun(studio, visitor), begun(studio, visitor)
    assert visitor.post("/api/stop").json() == {"stopped": 0, "heard": 0}
    with locked(entry.folder):
        assert visitor.post("/api/stop").json() == {"stopped": 1, "heard": 0}
        assert entry.folder.stop.exists() and not other.folder.stop.exists()
        assert not entry.folder.robot_stop.exists(), "nothing is painted yet"
        wait_for(lambda: audit_records(studio) == ["stop", "stop"])


def test_who_asked_for_what_and_when_is_kept_for_good(studio: Studio, visitor: Visitor, started: Any) -> None:
    entry = begun(studio, visitor)
    finish_plan(entry)
    path = f"/api/paintings/{entry.id}"
    assert visitor.post(f"{path}/start", json={"plan": 1, "ready": True}).status_code == 200
    entry.folder.painting.mkdir()
    with locked(entry.folder):
        assert visitor.post(f"{path}/say", json={"kind": "pause"}).status_code == 200
        region = {"kind": "protect", "picture": PICTURE, "only": True}
        assert visitor.post(f"{path}/say", json=region).status_code == 200
        assert visitor.post(f"{path}/say", json={**region, "picture": "f" * 32}).status_code == 422
        for place in (path, "/api/calibration"):
            moved = {"question": "f" * 16, "step": -0.001}
            assert visitor.post(f"{place}/answer", json=moved).status_code == 409, "nobody asks"
        assert visitor.post("/api/stop").status_code == visitor.post("/api/lead").status_code == 200
    moved = "answer: step -0.001"
    told = ["start plan 1", "pause", f"protect, picture {PICTURE}, only True", moved, moved, "lead", "stop"]
    wait_for(lambda: sorted(audit_records(studio)) == sorted(told))  # a stop is put down after it was done
    with closing(sqlite3.connect(studio.store.root / "studio.sqlite")) as base:
        whose = {(by, datetime.fromisoformat(at).date()) for at, by in base.execute("SELECT at, by FROM deed")}
        assert whose == {(visitor.client.cookies["studio-8350"], datetime.now().date())}
        for change in ("UPDATE deed SET what = ''", "DELETE FROM deed"):
            with pytest.raises(sqlite3.IntegrityError, match="only added to"):
                base.execute(change)


def test_networks_are_fetched_by_a_command_and_never_by_the_page(
    visitor: Visitor, started: Any, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv(VARIABLE, str(tmp_path / "no models"))
    told = visitor.get("/api/studio").json()["abilities"]
    ready = {"ready": True, "missing": [], "fetch": [], "advice": ""}
    assert told["image"] == {
        **ready,
        "label": "Picture",
        "verb": "Another picture to reproduce, pixel by pixel",
        "words": False,
    }
    assert told["text"]["missing"] == ["minilm"] and not told["text"]["ready"]
    answer = visitor.post("/api/paintings", json={"terms": [{"kind": "text", "words": "a ship"}]})
    assert answer.status_code == 422 and "frida-painter models fetch words" in answer.json()["sentence"]
    assert started == []


PATHS = [
        "live/..%2f..%2fstudio.sqlite", "live/../wish.json", "..%2f..%2f/x.jpg", "1/wish.json%00.jpg", "1/goal.toml",
        "live/%2e%2e",
        "painting/C:%5cx.jpg", "01/plan.jpg", "live/.hidden.jpg", "live/link.jpg", "painting2/a.jpg",
]  # fmt: skip


def test_only_files_that_are_meant_to_be_seen_are_given(
    studio: Studio, visitor: Visitor, started: Any, tmp_path: Path
) -> None:
    entry = begun(studio, visitor)
    for folder in ("live", "painting", "painting2"):
        (entry.folder.path / folder).mkdir()
    (entry.folder.path / "painting2" / "a.jpg").write_bytes(b"x")
    (tmp_path / "secret.jpg").write_bytes(b"secret")
    (entry.folder.path / "live" / "link.jpg").symlink_to(tmp_path / "secret.jpg")
    (entry.folder.path / "live" / ".hidden.jpg").write_bytes(b"x")
    for path in PATHS:
        answer = visitor.get(f"/paintings/{entry.id}/{path}")
        assert answer.status_code in (404, 405) and b"secret" not in answer.content, path
    (entry.folder.path / "live" / "seen.jpg").write_bytes(b"x")
    assert visitor.get(f"/paintings/{entry.id}/live/seen.jpg").content == b"x"


def test_paintings_that_are_not_there_are_not_found(visitor: Visitor) -> None:
    for identifier in ("0123456789abcdef", "..", "%2e%2e", "x" * 80, "' OR 1=1 --", "0123456789ABCDEF"):
        assert visitor.get(f"/api/paintings/{identifier}").status_code in (404, 422), identifier


BODIES = [
        (b"", "required"), (b"{", "JSON"), (b"[]", "dictionary"), (b'{"terms": []}', "nothing to paint yet"),
        (b'{"terms": [{"kind": "image", "picture": "' + b"0" * 32 + b'"}]}', "gone"),
        (b'{"terms": [{"kind": "image", "picture": "' + b"0" * 32 + b'", "weight": NaN}]}', "finite"),
        (b'{"terms": [], "<script>": 1}', ""), (b'{"a":' * 20000, "parsing"), (b"\xff\xfe", ""),
]  # fmt: skip


def test_what_is_not_understood_is_refused_in_a_sentence(visitor: Visitor) -> None:
    for body, says in BODIES:
        answer = visitor.post("/api/paintings", content=body, headers={"Content-Type": "application/json"})
        told = answer.json()
        assert 400 <= answer.status_code < 500 and says in told["sentence"] + told.get("fault", ""), body[:60]
        assert "script" not in answer.text and "Traceback" not in answer.text and "body." not in answer.text


def test_what_nobody_foresaw_gets_a_number_and_nothing_else(
    studio: Studio, visitor: Visitor, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def fail(*_: object) -> None:
        raise RuntimeError(f"secret in {studio.store.root}")

    monkeypatch.setattr(type(studio.store), "all", fail)
    answer = visitor.get("/api/paintings")
    assert answer.status_code == 500 and "secret" not in answer.text and "Traceback" not in answer.text
    number = answer.json()["sentence"].rstrip(".").split()[-1]
    assert number in capsys.readouterr().err


def test_a_full_disk_is_told_without_a_path(studio: Studio, visitor: Visitor, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(
        "frida_painter.system.storage.shutil.disk_usage", lambda path: type("Usage", (), {"free": 1000})()
    )
    file = io.BytesIO()
    Image.new("RGB", (64, 48)).save(file, "PNG")
    answer = visitor.post("/api/pictures", content=file.getvalue())
    assert answer.status_code == 422 and "free" in answer.json()["sentence"]
    assert str(studio.store.root) not in answer.text


def test_a_painting_can_be_taken_along_and_deleted(studio: Studio, visitor: Visitor, started: Any) -> None:
    entry = begun(studio, visitor)
    path = f"/api/paintings/{entry.id}"
    assert visitor.get(f"{path}/everything.zip").status_code == 404
    (entry.folder.painting / "photographs").mkdir(parents=True)
    (entry.folder.painting / "index.html").write_text("page")
    for name in (".reserve", "inbox.jsonl", "live/made.jpg"):
        (entry.folder.painting / name).parent.mkdir(exist_ok=True)
        (entry.folder.painting / name).write_text("for the page alone")
    (entry.folder.painting / ".arm").mkdir()
    (entry.folder.painting / ".arm" / "0.mp4").write_text("a piece of a film")
    (entry.folder.painting / "photographs" / "look.png").write_text("look")
    archive = zipfile.ZipFile(io.BytesIO(visitor.get(f"{path}/everything.zip").content))
    assert archive.namelist() == ["painting/index.html", "painting/photographs/look.png"]
    assert archive.testzip() is None and archive.read("painting/index.html") == b"page"
    assert visitor.post(f"{path}/delete").status_code == 200
    assert not entry.folder.path.exists() and visitor.get(path).status_code == 404
    assert visitor.get("/api/paintings").json() == []


def test_a_painting_that_was_stopped_is_gone_on_with(studio: Studio, visitor: Visitor, started: Any) -> None:
    entry = begun(studio, visitor)
    path = f"/api/paintings/{entry.id}"
    assert "nothing to go on with" in visitor.post(f"{path}/resume").json()["sentence"]
    start_painting(visitor, entry)
    (entry.folder.painting / "journal").unlink()
    journal = Journal.begin(entry.folder.painting, {"robot": "virtual"}, {})
    journal.show(Stopped())
    assert visitor.post(f"{path}/resume").status_code == 409, "a terminal has gone on with it"
    assert visitor.post(f"{path}/delete").status_code == 409
    journal.close()
    for file in (entry.folder.stop, entry.folder.robot_stop):
        file.touch()
    # Earlier versions latched simulated robots as well; that holds no more.
    Latch(latch_path(entry.folder.easel, "virtual"), "virtual").engage("you stopped it")
    assert visitor.post(f"{path}/resume").status_code == 200
    assert started[-1] == ("resume", 1)
    assert not entry.folder.stop.exists() and not entry.folder.robot_stop.exists()
    with locked(entry.folder):
        assert visitor.get(path).json()["painting"]["status"] == "preparing"
        journal = Journal.reopen(entry.folder.painting)[0]
        journal.record_resume(repaint=True)
        journal.show(ResultFound("results", detail={"film": False}))
        journal.close()
    assert "finished" in visitor.post(f"{path}/resume").json()["sentence"]


def said_of(visitor: Visitor, entry: Entry) -> dict[str, tuple[str, bool]]:
    """What each view says of a painting: its stage, and if somebody is at work on it."""
    card = next(each for each in visitor.get("/api/paintings").json() if each["id"] == entry.id)
    page = visitor.get(f"/api/paintings/{entry.id}").json()
    work = visitor.get("/api/work").json()["working"]
    return {
        "gallery": (card["stage"], card["working"]),
        "page": (page["stage"], page["working"]),
        "work": (page["stage"], entry.id in work),
    }


def test_a_folder_that_is_deleted_while_it_is_painted_is_told_the_same_everywhere(
    studio: Studio, visitor: Visitor, started: list[tuple[str, int]]
) -> None:
    entry = start_painting(visitor, begun(studio, visitor))
    with locked(entry.folder):
        shutil.rmtree(entry.folder.path)
        again = Studio(studio.store.root).visitor()  # a studio that is opened again knows it as well
        for each in (visitor, again):
            assert set(said_of(each, entry).values()) == {("lost", True)}
            assert "press Stop" in each.get(f"/api/paintings/{entry.id}").json()["trouble"]
        assert visitor.post("/api/stop").json()["stopped"] == 1
        assert visitor.post(f"/api/paintings/{entry.id}/delete").status_code == 409
    for each in (visitor, again):
        assert set(said_of(each, entry).values()) == {("lost", False)}
    assert visitor.post(f"/api/paintings/{entry.id}/resume").status_code == 409
    entry.folder.painting.mkdir(parents=True)  # the last that the painter wrote
    assert set(said_of(visitor, entry).values()) == {("lost", False)}
    assert visitor.post(f"/api/paintings/{entry.id}/delete").status_code == 200
    assert visitor.get("/api/paintings").json() == []


def test_one_browser_leads_only_while_something_may_move(studio: Studio, started: Any) -> None:
    first, second = studio.visitor(), studio.visitor()
    entry = start_painting(first, begun(studio, first))
    say, pause = f"/api/paintings/{entry.id}/say", {"kind": "pause"}
    with locked(entry.folder) as lock:
        assert first.post(say, json=pause).status_code == 200
        refused = second.post(say, json=pause)
        assert refused.status_code == 409 and refused.json()["led"]
        lock.sign("plan")  # a planner moves nothing
        assert second.post(say, json=pause).status_code == 200
        with (entry.folder.painting / "journal").open() as journal:
            assert locks.take(journal.fileno())  # a terminal goes on with it
            assert first.post(say, json=pause).json()["led"]
        lock.sign("paint")
        assert first.post(say, json=pause).json()["led"]
    assert "Nothing is being painted" in first.post(say, json=pause).json()["sentence"], "it leads, and is told why not"


@pytest.fixture
def busy(monkeypatch: pytest.MonkeyPatch) -> None:
    """As many as may be are at work on other paintings."""
    monkeypatch.setattr(Workers, "busy", property(lambda self: True))


def free(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Workers, "busy", property(lambda self: False))


def stage(visitor: Visitor, entry: Entry) -> str:
    return str(next(each["stage"] for each in visitor.get("/api/paintings").json() if each["id"] == entry.id))


def waiting(visitor: Visitor) -> list[tuple[str, str]]:
    return [(each["title"], each["job"]) for each in visitor.get("/api/work").json()["queue"]]


def test_what_is_asked_of_a_busy_painter_waits_in_order_and_is_begun_by_itself(
    studio: Studio, visitor: Visitor, started: list[tuple[str, int]], busy: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    first, second = begun(studio, visitor), begun(studio, visitor)
    assert started == [] and waiting(visitor) == [("Tea", "plan")] * 2 and stage(visitor, second) == "waiting"
    state = visitor.get(f"/api/paintings/{first.id}").json()
    assert (state["stage"], state["plans"][0]["status"], state["trouble"]) == ("waiting", "waiting", "")
    assert visitor.post(f"/api/paintings/{first.id}/plans", json=painting_request()).status_code == 409
    assert [plan["status"] for plan in visitor.get(f"/api/paintings/{first.id}").json()["plans"]] == ["waiting"]
    assert visitor.post(f"/api/queue/{second.id}/first").status_code == 200
    queue = visitor.get("/api/work").json()["queue"]
    assert [each["painting"] for each in queue] == [second.id, first.id]
    studio.web.queue.advance()
    assert started == []
    free(monkeypatch)
    again = PaintingQueue(studio.store, studio.web.workers)  # it is kept where the studio is started anew
    assert again.to_plain()["queue"] == [{key: each[key] for key in ("painting", "plan", "job")} for each in queue]
    studio.web.queue.advance()
    assert started == [("plan", 1)] * 2 and waiting(visitor) == []
    assert visitor.get(f"/api/paintings/{first.id}").json()["stage"] != "waiting"


def test_a_stop_holds_the_queue_until_a_person_lets_it_go_on(
    studio: Studio, visitor: Visitor, started: list[tuple[str, int]], busy: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    entry = begun(studio, visitor)
    assert not visitor.get("/api/work").json()["held"]
    assert visitor.post("/api/stop").json()["stopped"] >= 1
    free(monkeypatch)
    studio.web.queue.advance()
    assert started == [] and visitor.get("/api/work").json()["held"]
    assert begun(studio, visitor).id != entry.id and started == []  # who comes later does not overtake
    watcher = studio.visitor(Role.plan)
    assert watcher.post("/api/queue/go-on").status_code == 403
    assert visitor.post("/api/queue/go-on").status_code == 200
    studio.web.queue.advance()
    assert started == [("plan", 1)] * 2


def test_a_painting_waits_for_others_and_is_painted_where_the_robot_is_simulated(
    studio: Studio, visitor: Visitor, started: list[tuple[str, int]]
) -> None:
    entry = begun(studio, visitor)
    finish_plan(entry)
    order = {"plan": 1, "ready": False, "wait": True}
    assert visitor.post(f"/api/paintings/{entry.id}/start", json=order).status_code == 200
    assert visitor.post(f"/api/paintings/{entry.id}/start", json=order).status_code == 409  # once
    assert waiting(visitor) == [("Tea", "paint")]
    studio.web.queue.advance()
    assert started == [("plan", 1), ("paint", 1)] and waiting(visitor) == []
    assert stage(visitor, entry) != "planned"
    assert "start plan 1" in audit_records(studio)


def test_a_real_robot_paints_nothing_by_itself(tmp_path: Path, started: list[tuple[str, int]]) -> None:
    studio = with_picture(Studio(tmp_path / "store", WebAppEasel(tmp_path / "record.json", robot="human")))
    visitor = studio.visitor()
    entry = begun(studio, visitor)
    finish_plan(entry)
    visitor.post(f"/api/paintings/{entry.id}/start", json={"plan": 1, "ready": False, "wait": True})
    studio.web.queue.advance()
    assert started == [("plan", 1)] and waiting(visitor) == [("Tea", "paint")]
    assert visitor.post(f"/api/paintings/{entry.id}/start", json={"plan": 1, "ready": True}).status_code == 200
    assert started[-1] == ("paint", 1) and waiting(visitor) == []


def test_what_waits_is_taken_out_by_hand_or_with_its_painting(
    studio: Studio, visitor: Visitor, started: list[tuple[str, int]], busy: None
) -> None:
    first, second = begun(studio, visitor), begun(studio, visitor)
    assert visitor.post(f"/api/queue/{first.id}/remove").status_code == 200
    assert visitor.get(f"/api/paintings/{first.id}").json()["plans"][0]["status"] == "stopped"
    assert visitor.post(f"/api/paintings/{second.id}/delete").status_code == 200
    assert waiting(visitor) == []
    assert visitor.post("/api/stop").json()["stopped"] == 0  # nobody waits, so nothing is stopped


def test_a_damaged_queue_is_begun_anew(studio: Studio, visitor: Visitor, busy: None) -> None:
    begun(studio, visitor)
    (studio.store.root / "queue/queue.json").write_text("{")
    assert PaintingQueue(studio.store, studio.web.workers).to_plain() == {"held": False, "queue": []}


def test_what_the_camera_sees_is_shown_while_it_is_new(
    studio: Studio, visitor: Visitor, started: list[tuple[str, int]]
) -> None:
    entry = begun(studio, visitor)
    place = f"/api/paintings/{entry.id}/camera"
    assert visitor.get(place).status_code == 404
    entry.folder.painting.mkdir()
    entry.folder.camera.write_bytes(b"a picture")
    shown = visitor.get(place)
    assert (shown.content, shown.headers["content-type"]) == (b"a picture", "image/jpeg")
    os.utime(entry.folder.camera, (0, 0))
    assert visitor.get(place).status_code == 404


def test_what_is_taken_along_is_made_while_it_is_sent_and_follows_no_link(
    studio: Studio, visitor: Visitor, started: Any, tmp_path: Path
) -> None:
    entry, secret = begun(studio, visitor), tmp_path / "secret"
    secret.mkdir()
    (secret / "key.txt").write_text("secret")
    painting = entry.folder.painting
    painting.mkdir()
    (painting / "a.bin").write_bytes(bytes(10 * 2**20))
    (painting / "linked").symlink_to(secret)
    (painting / "key.txt").symlink_to(secret / "key.txt")
    pieces = list(zip_folder(painting))
    assert max(map(len, pieces)) < 2**19 and len(pieces) > 20
    with zipfile.ZipFile(io.BytesIO(b"".join(pieces))) as archive:
        assert archive.namelist() == ["painting/a.bin"]
    assert {path.name for path in painting.iterdir()} == {"a.bin", "linked", "key.txt"}
    painting.rename(entry.folder.path / "moved")
    painting.symlink_to(secret)
    assert visitor.get(f"/api/paintings/{entry.id}/everything.zip").status_code == 404


def test_a_locked_database_is_told_in_a_sentence(
    studio: Studio, visitor: Visitor, monkeypatch: pytest.MonkeyPatch
) -> None:
    connect = sqlite3.connect
    monkeypatch.setattr(sqlite3, "connect", lambda file, timeout: connect(file, timeout=0.01))
    with closing(connect(studio.store.root / "studio.sqlite", isolation_level=None)) as base:
        base.execute("BEGIN EXCLUSIVE")
        answer = visitor.get("/api/paintings")
        assert answer.status_code == 422 and "try again" in answer.json()["sentence"]
        assert visitor.post("/api/stop").json() == {"stopped": 0, "heard": 0}


def test_a_file_that_is_deleted_while_it_is_sent_is_told_in_a_sentence_and_a_zip_goes_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "film.mp4"
    path.write_bytes(b"film")
    found = os.stat

    def deleted_after(name: Any, *more: Any, **known: Any) -> os.stat_result:
        told = found(name, *more, **known)
        if name == path:
            path.unlink()
        return told

    async def films(scope: Any, receive: Any, send: Any) -> None:
        with monkeypatch.context() as patch:
            patch.setattr(os, "stat", deleted_after)
            await SentFile(path)(scope, receive, send)

    client = TestClient(films)
    for _ in range(2):  # deleted between two looks at it; and before the first
        answer = client.get("/")
        assert (answer.status_code, answer.json()) == (404, {"sentence": "This file was deleted."})
    for name in "ab":
        (tmp_path / name).write_bytes(b"x" * 300_000)
    archive = zip_folder(tmp_path)
    pieces = [next(archive)]
    (tmp_path / "a").unlink()
    (tmp_path / "b").unlink()
    assert zipfile.ZipFile(io.BytesIO(b"".join([*pieces, *archive]))).namelist() == ["painting/a"]


def test_a_taught_stroke_can_be_chosen_and_another_one_is_refused(
    studio: Studio, visitor: Visitor, started: list[tuple[str, int]]
) -> None:
    (studio.store.root / "families").mkdir()
    (studio.store.root / "families/hook.safetensors").write_bytes(b"")
    form = {control["name"]: control for control in visitor.get("/api/studio").json()["form"]["controls"]}
    assert {"strokes_of": "hook"} in [option["sets"] for option in form["strokes_of"]["options"]]
    wish = painting_request(PICTURE, brushes="fine")
    assert visitor.post("/api/paintings", json={**wish, "strokes_of": "hook:40%"}).status_code == 200
    refused = visitor.post("/api/paintings", json={**wish, "strokes_of": "crook"})
    assert refused.status_code == 422 and "no stroke family 'crook'" in refused.json()["sentence"]


def test_a_brush_of_another_package_can_be_chosen_and_one_that_nobody_has_is_refused(
    visitor: Visitor, started: list[tuple[str, int]], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    wish = painting_request(PICTURE, brushes="mop:40%,fine:60%")
    refused = visitor.post("/api/paintings", json=wish)
    assert refused.status_code == 422 and "Brush 'mop' is not known" in refused.json()["sentence"]
    refused = visitor.post("/api/calibration/start", json={"what": ["strokes"], "brush": "mop"})
    assert refused.status_code == 422 and "Brush 'mop' is not known" in refused.json()["sentence"]
    install(tmp_path / "mops", monkeypatch, "mops", {registry.STROKE_MODELS: {"mop": "mops:MOP"}})
    assert visitor.post("/api/paintings", json=wish).status_code == 200
    assert visitor.post("/api/calibration/start", json={"what": ["strokes"], "brush": "mop"}).status_code == 200


def test_settings_that_do_not_fit_together_are_refused_at_once_in_the_words_of_the_form(
    studio: Studio, visitor: Visitor, started: list[tuple[str, int]]
) -> None:
    (studio.store.pictures / f"{PICTURE}.png").write_bytes(b"")
    refused = visitor.post("/api/paintings", json=painting_request(brushes="broad,fine", minutes=10))
    assert refused.status_code == 422 and "“Robot's time” is 10" in refused.json()["sentence"]
    assert visitor.get("/api/paintings").json() == []


def test_a_drawing_without_a_goal_takes_nothing_that_only_a_goal_can_use(
    visitor: Visitor, started: list[tuple[str, int]]
) -> None:
    assert visitor.post("/api/paintings", json={"together": True}).status_code == 200
    words = [{"kind": "text", "words": "a cup"}]
    for more in ({"brushes": "fine,medium"}, {"minutes": 20}, {"strokes_of": "comma"}, {"terms": words}):
        assert visitor.post("/api/paintings", json={"together": True, **more}).status_code == 422, more


def test_a_painting_of_the_terminal_is_led_and_gone_on_with_like_any_other(
    studio: Studio, visitor: Visitor, started: Any
) -> None:
    folder = studio.store.root / "cup-20260101-120000"
    (folder / "goal").mkdir(parents=True)
    journal = Journal.begin(folder, {"strokes": 4, "canvas": "120x90mm", "robot": "human"}, {})
    journal.tell(StrokePainted(1, 4))
    (card,) = visitor.get("/api/paintings").json()
    assert (card["title"], card["stage"], card["working"]) == (folder.name, "painting", True)
    path = f"/api/paintings/{card['id']}"
    assert visitor.get(path).json()["painting"]["progress"]["painted"] == 1 and visitor.get("/api/work").json()["moves"]
    (studio.store.pictures / f"{PICTURE}.png").write_bytes(b"drawn")
    (studio.store.pictures / f"{PICTURE}.making.json").write_bytes(b"{}")
    inbox, goal = Inbox(folder, 0.0), {"kind": "goal", "terms": [{"kind": "image", "picture": PICTURE}]}
    for command in ({"kind": "pause"}, {"kind": "protect", "picture": PICTURE, "only": True}, goal, {"kind": "go on"}):
        assert visitor.post(f"{path}/say", json=command).status_code == 200
    choice = {"kind": "choose", "file": "changes/1/canvas.png"}
    assert visitor.post(f"{path}/say", json=choice).status_code == 422, "only a terminal chooses by the file"
    assert [each.command.kind for each in inbox.listen() if each.command] == ["pause", "protect", "goal", "go on"]
    assert {file.name for file in (folder / "given").iterdir()} == {f"{PICTURE}.png", f"{PICTURE}.making.json"}
    assert visitor.post(f"{path}/plans", json=painting_request()).status_code == 409
    assert visitor.post("/api/stop").status_code == 200 and (folder / "stop").exists()
    journal.show(Stopped())
    journal.close()
    assert visitor.get(path).json()["stage"] == "stopped" and visitor.get(path).json()["resumable"]
    assert visitor.post(f"{path}/say", json={"kind": "pause"}).status_code == 409, "it has ended"
    assert "'human', and this studio" in visitor.post(f"{path}/resume").json()["sentence"]
    again = studio.store.root / "tea-20260101-120000"
    (again / "goal").mkdir(parents=True)
    Journal.begin(again, {"strokes": 4, "robot": "virtual"}, {}).close()
    (other,) = (card for card in visitor.get("/api/paintings").json() if card["title"] == again.name)
    assert visitor.post(f"/api/paintings/{other['id']}/resume").status_code == 200 and started == [("resume", 0)]
    assert visitor.post(f"{path}/delete").status_code != 200 and (folder / "journal").exists()
