"""A painting that the terminal paints is led from a page of the studio, stopped there, and gone on with there."""

import io
import os
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import IO, Any

import pytest
from PIL import Image

from cli.test_stopping import Painter, paint
from frida_painter.errors import Interrupted
from frida_painter.runs.painting_folder import history_of
from frida_painter.runs.spec import RunSpec
from frida_painter.session.events import Paused, WentOn
from frida_painter.session.fold import PaintingState
from frida_painter.system import python_process
from frida_painter.system.operating_system import forget_keys
from frida_painter_cli import commands
from frida_painter_cli.leading import Leader
from frida_painter_studio.web_app_easel import WebAppEasel
from killing import ForkedProcess
from session.easel_errands import until
from support.studio import Studio, Visitor

State = dict[str, Any]


class Page:
    """A page that shows the only painting of a studio."""

    def __init__(self, visitor: Visitor) -> None:
        self.visitor = visitor

    @property
    def path(self) -> str:
        return f"/api/paintings/{self.visitor.get('/api/paintings').json()[0]['id']}"

    def see(self, holds: Callable[[State], object], seconds: float = 300) -> State:
        """The painting, as soon as it is so."""

        def look() -> State | None:
            time.sleep(0.2)  # who asks too often is refused
            cards = self.visitor.get("/api/paintings").json()
            state: State = self.visitor.get(self.path).json() if cards else {}
            assert state.get("stage") != "failed", state["trouble"]
            return state if state.get("painting") and holds(state) else None

        found: State = until(look, seconds)
        return found

    def say(self, kind: str, **more: Any) -> None:
        answer = self.visitor.post(f"{self.path}/say", json={"kind": kind, **more})
        assert answer.status_code == 200, answer.text

    def upload(self, left: int, right: int) -> str:
        """A picture whose halves have these greys."""
        file, picture = io.BytesIO(), Image.new("L", (120, 90), right)
        picture.paste(left, (0, 0, 40, 90))
        picture.save(file, "PNG")
        return str(self.visitor.post("/api/pictures", content=file.getvalue()).json()["id"])

    def shows(self, place: str, name: str) -> bool:
        return self.visitor.get(f"{self.path.removeprefix('/api')}/{place}/{name}").status_code == 200


@pytest.fixture
def page(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Page:
    """Of a studio whose workers are forked, as all programs of this room are."""

    begin = python_process.start

    def work(words: tuple[Any, ...]) -> None:
        sys.argv = ["frida-painter", *map(str, words[2:])]
        commands.main()

    def start(*words: Any, **more: Any) -> Any:
        if words[2] == "frida_painter_studio.worker_process:do_job":
            return ForkedProcess(lambda: python_process.serve(*words[2:]), **more)
        return ForkedProcess(lambda: work(words), **more) if words[1] == "frida_painter" else begin(*words, **more)

    monkeypatch.setattr(python_process, "start", start)
    return Page(Studio(tmp_path, WebAppEasel(tmp_path / "calibration.json", pace=0.05)).visitor())


@pytest.fixture
def painter(tmp_path: Path) -> Iterator[Painter]:
    begun = paint(tmp_path, "--pace", "0.05")
    yield begun
    begun.process.close()


def stage(*wanted: str) -> Callable[[State], bool]:
    return lambda state: state["stage"] in wanted


def test_what_the_terminal_paints_is_led_stopped_and_gone_on_with_from_a_page(page: Page, painter: Painter) -> None:
    page.see(lambda state: state["stage"] == "painting" and state["painting"]["progress"]["painted"] > 1)
    page.say("pause")
    paused = page.see(stage("paused"))["painting"]
    brushes = paused["people"]["may_paint"]
    assert brushes["wells"] and paused["wishes"]["pause"]["cause"] == "person"
    page.say("paint", brush=brushes["brushes"][0]["name"], paint=0, points=[[0.1, 0.5, 0.8, 0, 0, 0]])
    page.see(lambda state: state["painting"]["people"]["painted"] == 1)
    page.say("protect", picture=page.upload(255, 0), only=False)
    state = page.see(lambda state: state["stage"] == "paused" and state["painting"]["planning"]["replanned"])
    assert page.shows("regions", state["painting"]["wishes"]["region"]["drawing"])
    assert page.shows("live", f"{state['painting']['planning']['replanned']['shown']['prefix']}plan.jpg")
    page.say("goal", terms=[{"kind": "image", "picture": page.upload(20, 200)}])
    page.see(lambda state: state["stage"] == "paused" and state["painting"]["wishes"]["goals"])
    page.say("turns", count=2)
    page.say("go on")
    mine = page.see(
        lambda state: state["painting"]["wishes"]["pause"]["cause"] == "turn" and state["stage"] == "paused"
    )
    assert mine["painting"]["progress"]["painted"] <= paused["progress"]["painted"] + 3
    assert mine["painting"]["wishes"]["turns"]["policy"] == "alternate"
    page.say("turns", count=0)
    page.say("go on")
    page.see(stage("painting", "replanning"))
    assert page.visitor.post("/api/stop").json()["stopped"] == 1
    painter.process.wait(300)
    stopped = page.see(lambda state: state["stage"] == "stopped" and not state["working"])
    assert stopped["resumable"] and not (painter.folder / "stop").exists()
    assert page.visitor.post(f"{page.path}/resume").status_code == 200
    question = page.see(lambda state: state["question"] or state["stage"] == "painting")["question"]
    if question:  # a stroke is in doubt
        answer = {"question": question["id"], "yes": True}
        assert page.visitor.post(f"{page.path}/answer", json=answer).status_code == 200
    page.see(stage("painting"))
    page.say("pause")
    page.see(stage("paused"))
    page.say("go on")
    finished = page.see(stage("finished"), 600)["painting"]
    assert finished["wishes"]["region"] and finished["wishes"]["goals"][-1]["wish"]["terms"]
    assert finished["people"]["painted"] == 1


def test_a_plan_of_the_page_is_painted_by_the_words_of_the_terminal(page: Page, tmp_path: Path) -> None:
    request = {
        "terms": [{"kind": "image", "picture": page.upload(20, 200)}],
        "width": 120,
        "height": 90,
        "title": "Cup",
    }
    settings = {"strokes": 4, "replans": 1, "colors": 2, "brushes": "fine", "effort": 0.1}
    assert page.visitor.post("/api/paintings", json=request | settings).status_code == 200
    until(lambda: time.sleep(0.2) or page.visitor.get(page.path).json()["stage"] == "planned", 300)
    assert page.visitor.post(f"{page.path}/start", json={"plan": 1, "ready": True}).status_code == 200
    assert page.see(stage("finished"), 600)["painting"]["progress"]["painted"] == 4
    (painting,) = tmp_path.glob("*/painting")
    assert (painting / "strokes.svg").is_file() and history_of(painting).sittings.settings["title"] == "Cup"
    plan = painting.parent / "plans" / "1"
    assert RunSpec.from_toml(plan / ".settings.json", calibration=None).strokes == 4


class Run:
    """As much of a run as a pause needs."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.session, self.painting, self.history = folder, None, PaintingState(), None
        self.easel, self.mixed, self.is_stopped = SimpleNamespace(simulated=True), None, False
        self.listeners: list[Any] = []
        self.told: list[Any] = []
        self.report = self.told.append
        self.controls = SimpleNamespace(mixed=None)


@pytest.mark.parametrize(
    ("cause", "file", "typed", "goes_on"),
    [
        ("person", True, None, True),  # the pause file is removed
        ("person", False, None, True),  # it was gone before the robot stood still
        ("trouble", False, None, False),  # nobody is here
        ("trouble", False, "go\n", True),
        ("turn", False, "\nno\nGo \n", True),
    ],
)
def test_a_pause_ends_as_whoever_sits_at_the_terminal_wants_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, cause: Any, file: bool, typed: str | None, goes_on: bool
) -> None:
    keyboard, screen = os.openpty()

    def ask(terminal: IO[str]) -> None:
        """Types the answer as soon as what was typed before is forgotten."""
        forget_keys(terminal)
        os.write(keyboard, (typed or "").encode())

    monkeypatch.setattr("frida_painter_cli.leading.forget_keys", ask)
    monkeypatch.setattr("frida_painter_cli.leading.replace", lambda controls, **more: SimpleNamespace(**more))
    with os.fdopen(keyboard, "wb"), os.fdopen(screen) as terminal:
        monkeypatch.setattr(sys, "stdin", terminal if typed is not None else io.StringIO())
        run: Any = Run(tmp_path)
        leader = Leader(run, SimpleNamespace(asked=False), asked=False, started=0.0)  # type: ignore[arg-type]
        if file:
            (tmp_path / "pause").touch()
            assert leader._pause_cause() == "person"
            threading.Timer(0.3, (tmp_path / "pause").unlink).start()
        assert leader._go_on(Paused("It waits.", 3, cause)) is goes_on
        assert run.told == ([WentOn()] if goes_on else [])
        leader._over.set()


@pytest.mark.parametrize("file", [True, False])
def test_a_pause_of_the_pause_file_is_ended_by_a_page_too_and_what_was_owed_is_done_first(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, file: bool
) -> None:
    monkeypatch.setattr("frida_painter_cli.leading.replace", lambda controls, **more: SimpleNamespace(**more))
    asked: list[Any] = []

    def go_on(paused: Paused) -> bool:
        run.painting.hear(paused)
        asked.append(leader._pause_cause())  # as while it replans in the pause
        return True

    conductor = SimpleNamespace(go_on=go_on, pause_cause=lambda: "person")
    monkeypatch.setattr("frida_painter_cli.leading._lead_from_pages", lambda *_: conductor)
    (tmp_path / "inbox.jsonl").touch()
    run: Any = Run(tmp_path)
    leader = Leader(run, SimpleNamespace(asked=False), asked=False, started=0.0)  # type: ignore[arg-type]
    assert leader._pause_cause() == "person", "what a page asked for before is done before a stroke"
    if file:
        (tmp_path / "pause").touch()
        assert leader._pause_cause() == "person"
    assert leader._go_on(Paused("It waits.", 3, "person")) and asked == [None]
    assert not (tmp_path / "pause").exists()


def test_a_stop_at_a_page_ends_a_question_at_the_terminal(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("frida_painter_cli.leading.replace", lambda controls, **more: SimpleNamespace(**more))
    monkeypatch.setattr("frida_painter_cli.leading._lead_from_pages", lambda *_: SimpleNamespace())
    keyboard, screen = os.openpty()
    with os.fdopen(screen) as stdin:
        monkeypatch.setattr(sys, "stdin", stdin)
        run: Any = Run(tmp_path)
        stop: Any = SimpleNamespace(asked=False)
        leader = Leader(run, stop, asked=True, started=0.0, propose="command:true {canvas}")
        proposer: Any = leader._proposer
        threading.Timer(0.3, lambda: setattr(run, "is_stopped", True)).start()
        with pytest.raises(Interrupted):
            proposer._ask("What shall change? ")
    os.close(keyboard)
