from pathlib import Path
from typing import Any

import pytest

from frida_painter import calibration
from frida_painter.event_log import FEED, EventLog
from frida_painter.session.events import (
    Answered,
    Asked,
    CalibrationStarted,
    CalibrationStatus,
    Failed,
    ProcedureBegan,
    ProcedureFound,
    ProcedureProgress,
    Written,
    events_of,
    record,
)
from frida_painter.web.jobs import PROCEDURES, Calibration, CalibrationRequest
from frida_painter.web.painting_state import Truth
from frida_painter.web.studio_folder import Feed, WorkerLock
from frida_painter.web.web_app_easel import WebAppEasel
from frida_painter.web.workers import WorkerSlot
from support.studio import Studio, order

QUESTION = {"id": "f" * 16, "kind": "confirm", "text": "Is it so?", "proposal": True}


@pytest.fixture
def started(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    jobs: list[str] = []
    monkeypatch.setattr(WorkerSlot, "start", lambda self, job, plan: jobs.append(job))
    return jobs


def test_the_page_knows_the_procedures_that_there_are() -> None:
    assert PROCEDURES == calibration.PROCEDURES


def test_calibrating_begins_and_its_questions_are_answered(tmp_path: Path, started: list[str]) -> None:
    studio = Studio(tmp_path)
    visitor, folder = studio.visitor(), studio.store.job("calibration")
    assert [each["dated"] for each in visitor.get("/api/calibration").json()["procedures"]] == [None] * 5
    assert visitor.post("/api/calibration/start", json={"what": ["canvas", "brush"]}).status_code == 200
    assert started == ["calibration"] and CalibrationRequest.load(folder).what == ("canvas", "brush")
    Feed(folder).tell(Asked(QUESTION))
    (folder.live / "found-canvas.png").write_bytes(b"x")
    assert visitor.get("/api/calibration/files/found-canvas.png").content == b"x"
    assert visitor.get("/api/calibration/files/..%2fasked.json").status_code == 404
    answer = {"question": QUESTION["id"], "yes": True}
    assert visitor.post("/api/calibration/answer", json=answer).status_code == 409, "nobody waits for it"
    lock = WorkerLock(folder)
    assert lock.take()
    assert visitor.get("/api/calibration").json()["question"] == QUESTION
    assert visitor.post("/api/calibration/answer", json={**answer, "question": "0" * 16}).status_code == 409
    assert visitor.post("/api/calibration/answer", json={"question": QUESTION["id"]}).status_code == 422
    assert visitor.post("/api/calibration/answer", json=answer).status_code == 200
    assert EventLog.read(folder.replies, FEED)[0]["reply"]["yes"] is True
    assert visitor.post("/api/calibration/start", json={"what": ["canvas"]}).status_code == 409
    assert visitor.post("/api/stop").json() == {"stopped": 1, "heard": 0} and folder.stop.exists()
    lock.release()


@pytest.mark.slow
@pytest.mark.parametrize(
    "asked", [{"what": []}, {"what": ["robot", "canvas"]}, {"what": ["canvas", "canvas"]}, {"what": ["all"]},
             {"what": ["canvas"], "width": 1e9}, {"what": ["strokes"], "count": 3}, {"what": ["canvas"], "robot": "x"}]
)  # fmt: skip
def test_what_cannot_be_calibrated_is_refused(tmp_path: Path, started: list[str], asked: dict[str, Any]) -> None:
    answer = Studio(tmp_path).visitor().post("/api/calibration/start", json=asked)
    assert answer.status_code == 422 and started == []


def test_a_real_robot_is_not_moved_without_somebody_beside_it(tmp_path: Path, started: list[str]) -> None:
    studio = Studio(tmp_path, WebAppEasel(tmp_path / "record.json", "axidraw"))
    visitor = studio.visitor()
    refused = visitor.post("/api/calibration/start", json={"what": ["canvas"]})
    assert refused.status_code == 409 and "beside the robot" in refused.json()["sentence"] and started == []
    studio.presence.press()
    assert visitor.post("/api/calibration/start", json={"what": ["canvas"]}).status_code == 200


def test_an_order_without_its_number_or_from_a_second_browser_is_not_done(tmp_path: Path, started: list[str]) -> None:
    studio = Studio(tmp_path)
    first, second = studio.visitor(), studio.visitor()
    asked = {"what": ["canvas"]}
    nameless = first.post("/api/calibration/start", json=asked, headers={"X-Nonce": "", "X-Given": ""})
    assert nameless.status_code in (409, 422) and started == []
    same = order()
    assert first.post("/api/calibration/start", json=asked, headers=same).status_code == 200
    assert "already" in first.post("/api/calibration/start", json=asked, headers=same).json()["sentence"]
    lock = WorkerLock(studio.store.job("calibration"))
    assert lock.take()
    led = second.post("/api/calibration/start", json=asked)
    lock.release()
    assert led.status_code == 409 and led.json()["led"] is True
    studio.web.lead.under_way += 1
    assert second.post("/api/calibration/start", json=asked).status_code == 409, "an order is not done yet"
    studio.web.lead.under_way -= 1
    assert second.post("/api/stop").status_code == 200, "whoever may look may stop"
    assert second.post("/api/lead").status_code == 200
    assert second.post("/api/calibration/start", json=asked).status_code == 200
    assert started == ["calibration"] * 2


def told_of(stands: list[dict[str, Any]]) -> list[Written]:
    return [
        CalibrationStarted(["canvas", "robot"]), CalibrationStatus("e", stands), ProcedureBegan("canvas"),
        Asked(QUESTION), Answered(), ProcedureFound("canvas", "It is there.", "found-canvas.png"),
        ProcedureBegan("robot"), ProcedureProgress("dot 3"), ProcedureBegan("?"),
    ]  # fmt: skip


def test_what_is_found_is_followed() -> None:
    state = Calibration()
    stands = [{"name": "robot", "dated": "d", "fault": "f", "old": True}]
    for told in map(record, told_of(stands)):
        for event in events_of(told):
            state.hear(event)
    state.hear(ProcedureFound("?", "Not one of ours."))
    shown = state.to_plain(Truth(working=True))
    canvas, robot = shown["procedures"][:2]
    assert (canvas["status"], canvas["sentence"], robot["status"], robot["fault"]) == (
        "done",
        "It is there.",
        "busy",
        "f",
    )
    assert shown["progress"] == "dot 3" and shown["question"] is None
    assert "without saying why" in state.to_plain(Truth(working=False))["trouble"]
    state.hear(Failed("No dots."))
    assert state.to_plain(Truth(working=False))["procedures"][1]["status"] == "failed"
