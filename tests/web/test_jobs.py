"""Calibration, setup, teaching and picture making: one job with a feed, one set of routes, and one state for each."""

import json
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, get_args

import pytest
from pydantic import ValidationError

from frida_painter import calibration
from frida_painter.session import events
from frida_painter.system.event_log import FEED, EventLog
from frida_painter_calibration.procedures.workspace import STEPS
from frida_painter_studio.at_page import Feed
from frida_painter_studio.jobs import (
    JOBS,
    PROCEDURES,
    CalibrationJob,
    CalibrationRequest,
    Imagining,
    JobState,
    Setup,
    SetupRequest,
    StepName,
    Teaching,
    TeachingRequest,
)
from frida_painter_studio.painting_state import Truth
from frida_painter_studio.web_app_easel import WebAppEasel
from frida_painter_studio.workers import WorkerSlot
from frida_painter_together.commands import Role
from machines.grbl import router
from machines.simulated_time import Living
from support.studio import Studio, locked, order

PATIENCE = 60.0  # seconds
QUESTION = {"id": "f" * 16, "kind": "confirm", "text": "Is it so?", "proposal": True}
GUIDE = {
    "id": "a" * 16, "kind": "guide", "text": "Guide it.", "position": [0.1, 0.1, 0.02], "lower": [0, 0, 0],
    "upper": [1, 1, 1], "again": False, "remark": "", "steps": [0.02, 0.01], "leave": True,
}  # fmt: skip


@pytest.fixture
def started(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    jobs: list[str] = []
    monkeypatch.setattr(WorkerSlot, "start", lambda self, job, plan: jobs.append(job))
    return jobs


def marks(count: int = 10, points: int = 8) -> list[list[list[float]]]:
    return [[[float(mark + 4 * at), 10.0, 0.5, 0.1 * at] for at in range(points)] for mark in range(count)]


def test_the_page_knows_the_procedures_and_steps_that_there_are() -> None:
    assert PROCEDURES == calibration.PROCEDURES and tuple(STEPS) == get_args(StepName)


HOOK = {"name": "hook", "marks": marks()}
REFUSED: dict[str, list[dict[str, Any]]] = {
    "calibration": [
        {"what": []}, {"what": ["robot", "canvas"]}, {"what": ["canvas", "canvas"]}, {"what": ["all"]},
        {"what": ["canvas"], "width": 1e9}, {"what": ["strokes"], "count": 3}, {"what": ["canvas"], "robot": "x"},
    ],
    "setup": [
        {"easel": "../../etc"}, {"step": "dance"}, {"width": 100}, {"width": 1e9, "height": 100}, {"port": "/dev/x"},
        {"brush": "broom"}, {"easel": ""},
    ],
    "teaching": [
        {**HOOK, "marks": marks(9)}, {**HOOK, "marks": marks(61)}, {**HOOK, "marks": [*marks(9), []]},
        {**HOOK, "marks": marks(10, 401)}, {**HOOK, "marks": [*marks(9), [[0.0, 0.0, 1.5, 0.0]] * 5]},
        {**HOOK, "marks": [*marks(9), [[0.0, 5000.0, 0.5, 0.0]] * 5]}, {**HOOK, "marks": [*marks(9), [[0.0, 0.0]] * 5]},
        *({**HOOK, "name": name} for name in ("../hook", "Hook", "comma", "taken")),
        {**HOOK, "brush": "mop"}, {**HOOK, "count": 10_000},
    ],
    "imagining": [
        {"words": "a hat", "maker": "command: true", "seed": -1}, {"words": "--out=x", "maker": "command: true"},
        {"words": "a hat", "maker": "command:touch here"}, {"words": "a\x1bhat", "maker": "command: true"},
        {"words": "@file", "maker": "command: true"}, {"words": "a hat", "maker": "command: true", "out": "here"},
    ],
}  # fmt: skip


def test_orders_that_cannot_be_are_refused_with_a_sentence(tmp_path: Path, started: list[str]) -> None:
    studio = Studio(tmp_path)
    (tmp_path / "families").mkdir()
    (tmp_path / "families/taken.safetensors").write_bytes(b"")
    visitor = studio.visitor()
    assert set(REFUSED) == set(JOBS)
    for name, orders in REFUSED.items():
        for asked in orders:
            studio.presence.press()
            answer = visitor.post(f"/api/{name}/start", json=asked)
            assert answer.status_code == 422 and answer.json()["sentence"].endswith((".", "?")), (name, asked)
    assert started == []


@pytest.mark.parametrize(("robot", "guarded"), [("virtual", {"setup"}), ("axidraw", {"setup", "calibration"})])
def test_no_machine_is_moved_unless_somebody_stands_beside_it(
    tmp_path: Path, started: list[str], robot: str, guarded: set[str]
) -> None:
    """A setup moves a real machine at every easel, a calibration that of its own."""
    studio = Studio(tmp_path, WebAppEasel(tmp_path / "record.json", robot))
    visitor = studio.visitor()
    for name, asked in (("setup", {"brush": "fine"}), ("calibration", {"what": ["canvas"]}), ("teaching", HOOK)):
        for role in (Role.watch, Role.plan):
            assert studio.visitor(role).post(f"/api/{name}/start", json=asked).status_code == 403
        if name in guarded:
            refused = visitor.post(f"/api/{name}/start", json=asked)
            assert refused.status_code == 409 and "beside the robot" in refused.json()["sentence"]
            studio.presence.press()
        assert visitor.post(f"/api/{name}/start", json=asked).status_code == 200
    assert started == ["setup", "calibration", "teaching"]
    assert SetupRequest.load(studio.store.job("setup").path).brush == "fine"
    assert visitor.post("/api/setup/start", json={}).status_code == 409, "a confirmation is good for one thing"
    assert visitor.get("/api/teaching").json()["name"] == "hook"


def test_questions_are_answered_by_whoever_leads(tmp_path: Path, started: list[str]) -> None:
    studio = Studio(tmp_path)
    visitor, folder = studio.visitor(), studio.store.job("calibration")
    assert [each["dated"] for each in visitor.get("/api/calibration").json()["procedures"]] == [None] * 5
    assert visitor.post("/api/calibration/start", json={"what": ["canvas", "brush"]}).status_code == 200
    assert CalibrationRequest.load(folder.path).what == ("canvas", "brush")
    Feed(folder.path).tell(events.Asked(QUESTION))
    (folder.path / "live").mkdir()
    (folder.path / "live" / "found-canvas.png").write_bytes(b"x")
    assert visitor.get("/api/calibration/files/found-canvas.png").content == b"x"
    assert visitor.get("/api/calibration/files/..%2f.asked.json").status_code == 404
    answer = {"question": QUESTION["id"], "yes": True}
    assert visitor.post("/api/calibration/answer", json=answer).status_code == 409, "nobody waits for it"
    with locked(folder):
        assert visitor.get("/api/calibration").json()["question"] == QUESTION
        assert visitor.post("/api/calibration/answer", json={**answer, "question": "0" * 16}).status_code == 409
        assert visitor.post("/api/calibration/answer", json={"question": QUESTION["id"]}).status_code == 422
        assert visitor.post("/api/calibration/answer", json=answer).status_code == 200
        second = studio.visitor().post("/api/calibration/answer", json=answer)
        assert second.status_code == 409 and second.json()["led"] is True
        assert EventLog.read(folder.path / "inbox.jsonl", FEED)[0]["reply"]["yes"] is True
        assert visitor.post("/api/calibration/start", json={"what": ["canvas"]}).status_code == 409
        assert visitor.post("/api/stop").json() == {"stopped": 1, "heard": 0} and folder.stop.exists()
    folder = studio.store.job("setup")
    Feed(folder.path).tell(events.Asked(GUIDE))
    with locked(folder):
        for given in ({"move": [0.01, 0.0, 0.0]}, {"leave": True}):
            assert visitor.post("/api/setup/answer", json={"question": GUIDE["id"], **given}).status_code == 200
    move, left = (line["reply"] for line in EventLog.read(folder.path / "inbox.jsonl", FEED))
    assert move["move"] == [0.01, 0.0, 0.0] and left["leave"] is True


def test_an_order_without_its_number_or_from_a_second_browser_is_not_done(tmp_path: Path, started: list[str]) -> None:
    studio = Studio(tmp_path)
    first, second = studio.visitor(), studio.visitor()
    asked = {"what": ["canvas"]}
    nameless = first.post("/api/calibration/start", json=asked, headers={"X-Nonce": "", "X-Given": ""})
    assert nameless.status_code in (409, 422) and started == []
    same = order()
    assert first.post("/api/calibration/start", json=asked, headers=same).status_code == 200
    assert "already" in first.post("/api/calibration/start", json=asked, headers=same).json()["sentence"]
    with locked(studio.store.job("calibration")):
        led = second.post("/api/calibration/start", json=asked)
    assert led.status_code == 409 and led.json()["led"] is True
    studio.web.lead.under_way += 1
    assert second.post("/api/calibration/start", json=asked).status_code == 409, "an order is not done yet"
    studio.web.lead.under_way -= 1
    assert second.post("/api/stop").status_code == 200, "whoever may look may stop"
    assert second.post("/api/lead").status_code == 200
    assert second.post("/api/calibration/start", json=asked).status_code == 200
    assert started == ["calibration"] * 2


BEGUN: list[tuple[type[JobState], Any]] = [
    (CalibrationJob, events.Began("calibration", detail={"what": ["canvas"]})),
    (Setup, events.Began("setup")),
    (Teaching, events.Began("teaching", detail={"name": "hook"})),
    (Imagining, events.Began("imagining", detail={"words": "a hat", "label": "command: true"})),
]


@pytest.mark.parametrize(("job", "begun"), BEGUN, ids=[job.name for job, _ in BEGUN])
def test_a_process_that_ended_without_a_word_is_told_with_its_remedy(job: type[JobState], begun: Any) -> None:
    state, rests = job(), Truth(working=False)

    def trouble(truth: Truth = rests) -> str:
        return str(state.to_plain(truth)["trouble"])

    assert trouble() == ""  # nothing was begun
    state.hear(begun)
    assert trouble(Truth(working=True)) == ""
    assert "without saying why. It may have been killed" in trouble() and trouble().endswith(f" {job.remedy}")
    assert "disk is full" in trouble(Truth(working=False, room=False))
    state.hear(events.Stopped("The disk is full."))
    assert trouble() == "The disk is full."
    state.hear(begun)
    state.hear(events.Stopped())
    assert trouble() == "" and state.to_plain(rests)["stopped"]
    json.dumps(state.to_plain(rests))


def test_a_calibration_tells_what_each_procedure_found() -> None:
    state = CalibrationJob()
    stands = [{"name": "robot", "dated": "d", "fault": "f", "old": True}]
    for event in (
        events.Began("calibration", detail={"what": ["canvas", "robot"]}),
        *(events.ResultFound("status", each["name"], detail={"easel": "e", **each}) for each in stands),
        events.Began("procedure", "canvas"),
        events.Asked(QUESTION),
        events.Asked(None),
        events.ResultFound("procedure", "canvas", detail={"sentence": "It is there.", "picture": "found-canvas.png"}),
        events.Began("procedure", "robot"),
        events.Advanced("dot 3"),
        events.Began("procedure", "?"),
        events.ResultFound("procedure", "?", detail={"sentence": "Not one of ours."}),
    ):
        state.hear(event)
    shown = state.to_plain(Truth(working=True))
    canvas, robot = shown["procedures"][:2]
    told = canvas["status"], canvas["sentence"], robot["status"], robot["fault"]
    assert told == ("done", "It is there.", "busy", "f")
    assert shown["progress"] == "dot 3" and shown["question"] is None
    state.hear(events.Stopped("The light is off."))
    ended = state.to_plain(Truth(working=False))
    assert [each["status"] for each in ended["procedures"][:2]] == ["done", "failed"]
    assert ended["trouble"] == "The light is off."


def test_a_setup_tells_its_step_and_that_it_was_left() -> None:
    state = Setup()
    begun = events.Began("setup"), events.Began("step", "touch")
    for event in (*begun, events.Remark("Not so deep."), events.Asked(GUIDE)):
        state.hear(event)
    shown = state.to_plain(Truth(working=True))
    assert (shown["step"], shown["remarks"], shown["question"]) == ("touch", ["Not so deep."], GUIDE)
    state.hear(events.ResultFound("left", "You left."))
    left = state.to_plain(Truth(working=False))
    assert left["left"] == "You left." and left["trouble"] == ""


def test_a_page_that_follows_the_setup_is_a_sign_for_its_worker(tmp_path: Path) -> None:
    studio = Studio(tmp_path)
    sign = studio.store.job("setup").path / "followed"
    for name, follows in (("calibration", False), ("setup", True)):
        topic = studio.web.topic(name)
        assert topic is not None
        topic.mark()
        assert sign.exists() == follows


def test_stop_ends_a_motion_of_the_setup_and_a_person_must_arm_the_machine(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("DATA", "CONFIG", "STATE"):
        monkeypatch.setenv(f"XDG_{name}_HOME", str(tmp_path / name))
    studio, machine = Studio(tmp_path / "studio"), router()
    visitor = studio.visitor()

    def wait_for(what: Callable[[dict[str, Any]], object]) -> dict[str, Any]:
        until = time.monotonic() + PATIENCE
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
        answer("Shall it drive to its limit switches", yes=True)
        answer("From now on the tip moves", yes=True)
        answer("bottom-left", settled=True)
        asked = wait_for(lambda state: "bottom-right" in (state["question"] or {}).get("text", ""))["question"]
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


@pytest.mark.parametrize(("name", "refused"), [("con", True), ("com1", True), ("grass", False)])
def test_a_family_has_a_name_that_a_file_may_have_on_every_system(name: str, refused: bool) -> None:
    with pytest.raises(ValidationError) as found:
        TeachingRequest.model_validate({"name": name, "marks": []})
    assert (("name",) in [each["loc"] for each in found.value.errors()]) is refused
