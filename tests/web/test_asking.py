import threading
import time
from pathlib import Path
from typing import Any

import pytest
import torch

from frida_painter.easel.dialogue import Answer, Confirm, Jog, JogMove, Measure, PointCorners, Question
from frida_painter.errors import ConfigError, Interrupted
from frida_painter.session.events import Answered, Asked
from frida_painter_studio import commands, painter
from frida_painter_studio.commands import LEAD_GOOD_FOR, Inbox, Reply, tell_worker
from frida_painter_studio.painter import MAX_ABSENCE, Asker, describe_question
from frida_painter_studio.stop import StopPressed, StopWatch
from frida_painter_studio.studio_folder import Feed, FeedReader, PaintingFolder
from frida_painter_studio.web_studio import Followed

PICTURE = torch.zeros(3, 20, 30)
CORNERS = ((1.25, 1.0), (25.0, 1.0), (25.0, 15.0), (1.0, 15.0))
QUESTIONS: list[tuple[Question, dict[str, Any], Answer]] = [
    (Confirm("Is it so?", PICTURE), {"yes": False}, False),
    (PointCorners("Where?", PICTURE, CORNERS), {"corners": [list(each) for each in CORNERS]}, CORNERS),
    (Jog("Up?", 0.1, 0.0, 0.2, proposal=None), {"step": 0.005}, JogMove(0.005)),
    (Jog("Up?", 0.1, 0.0, 0.2, proposal=None), {"settled": True}, JogMove(settled=True)),
    (Measure("How long?", 0.0, 0.5), {"length": 0.25}, 0.25),
]


@pytest.fixture
def folder(tmp_path: Path) -> PaintingFolder:
    (tmp_path / "live").mkdir()
    return PaintingFolder(tmp_path)


def asked(folder: PaintingFolder) -> dict[str, Any]:
    """The question that stands in the feed, once it does."""
    deadline = time.monotonic() + 20
    while time.monotonic() < deadline:
        for event in FeedReader(folder.feed).read():
            if isinstance(event, Asked):
                return event.question
        time.sleep(0.01)
    raise AssertionError("nothing is asked")


@pytest.mark.parametrize(("question", "says", "means"), QUESTIONS)
def test_a_question_waits_for_its_answer_and_no_other(
    folder: PaintingFolder, question: Question, says: dict[str, Any], means: Answer
) -> None:
    asker, found = Asker(folder, Feed(folder), StopWatch(folder.stop, folder.path.parent)), list[Answer]()
    waiting = threading.Thread(target=lambda: found.append(asker.answer(question)), daemon=True)
    waiting.start()
    shown = asked(folder)
    assert ("picture" in shown) == (getattr(question, "picture", None) is not None)
    tell_worker(folder, Reply.model_validate({"question": "0" * 16, **says}), "browser")
    tell_worker(folder, Reply.model_validate({"question": shown["id"]}), "browser")
    waiting.join(0.2)
    assert waiting.is_alive(), "these were answers to something else, or none"
    tell_worker(folder, Reply.model_validate({"question": shown["id"], **says}), "browser")
    waiting.join(20)
    assert found == [means]
    assert FeedReader(folder.feed).read()[-1] == Answered()


def test_an_answer_that_comes_too_late_is_none(folder: PaintingFolder, monkeypatch: pytest.MonkeyPatch) -> None:
    tell_worker(folder, Reply(question="0" * 16, yes=True), "browser")
    assert len(Inbox(folder, 0.0).listen()) == 1
    now = time.time()
    monkeypatch.setattr(commands.time, "time", lambda: now + LEAD_GOOD_FOR + 1)
    assert Inbox(folder, 0.0).listen() == []


def test_stop_ends_a_question(folder: PaintingFolder) -> None:
    asker, caught = Asker(folder, Feed(folder), StopWatch(folder.stop, folder.path.parent)), list[BaseException]()

    def wait() -> None:
        try:
            asker.answer(Confirm("Is it so?"))
        except StopPressed as stop:
            caught.append(stop)

    waiting = threading.Thread(target=wait, daemon=True)
    waiting.start()
    asked(folder)
    folder.stop.touch()
    waiting.join(20)
    assert len(caught) == 1


class FollowedClock:
    """Time that passes while a question waits; a page follows it until `until`."""

    def __init__(self, path: Path, until: float) -> None:
        self.now, self.until, self.sign = 0.0, until, Followed(path)

    def monotonic(self) -> float:
        return self.now

    def sleep(self, seconds: float) -> None:
        self.now += 20.0
        if self.now <= self.until:
            self.sign._renewed = -1e9
            self.sign.renew()


@pytest.mark.parametrize("followed", [0.0, 2000.0])
def test_a_dialogue_that_no_page_follows_is_left_so_that_the_machine_is_free(
    folder: PaintingFolder, monkeypatch: pytest.MonkeyPatch, followed: float
) -> None:
    clock = FollowedClock(folder.followed, followed)
    monkeypatch.setattr(painter, "time", clock)
    asker = Asker(folder, Feed(folder), StopWatch(folder.stop, folder.path.parent), may_leave=True)
    with pytest.raises(Interrupted, match=r"No page was open for 10 minutes; what was done before is kept"):
        asker.answer(Confirm("Is it so?"))
    assert followed + MAX_ABSENCE <= clock.now <= followed + MAX_ABSENCE + 60
    assert FeedReader(folder.feed).read()[-1] == Answered(), "nothing is asked any more"


def test_a_question_of_a_painting_waits_for_days(folder: PaintingFolder, monkeypatch: pytest.MonkeyPatch) -> None:
    clock = FollowedClock(folder.followed, 0.0)
    monkeypatch.setattr(painter, "time", clock)
    stop = StopWatch(folder.stop, folder.path.parent)
    monkeypatch.setattr(clock, "sleep", lambda seconds: folder.stop.touch() if clock.now > 1e5 else advance())

    def advance() -> None:
        clock.now += 1e4

    with pytest.raises(StopPressed):
        Asker(folder, Feed(folder), stop).answer(Confirm("Are the wells filled?"))


@pytest.mark.parametrize(
    ("question", "says", "complaint"),
    [
        (Confirm("?"), {"length": 0.1}, "no answer"),
        (Jog("?", 0.1, 0.09, 0.11), {"step": 0.05}, "cannot go further"),
        (Measure("?", 0.0, 0.5), {"length": 0.6}, "0.0 to 500.0 mm"),
        (PointCorners("?", PICTURE, None), {"corners": [[0, 0], [31, 0], [9, 9], [0, 9]]}, "outside the photograph"),
    ],
)
def test_what_is_no_answer_is_refused(question: Question, says: dict[str, Any], complaint: str) -> None:
    shown = {**describe_question(question), "rows": 20, "columns": 30}
    with pytest.raises(ConfigError, match=complaint):
        Reply.model_validate({"question": "0" * 16, **says}).answering(shown["kind"], shown)
