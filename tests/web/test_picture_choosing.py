"""Pictures made from words on the page: only by makers that the owner allowed, with every way that they can fail."""

import json
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from frida_painter.errors import ConfigError, FridaError
from frida_painter.runs.goal_item import making_facts
from frida_painter.runs.spec import RunSpec
from frida_painter.system.python_process import OwnProcess
from frida_painter_studio import studio_command, studio_folder
from frida_painter_studio.at_page import Feed, StopPressed
from frida_painter_studio.picture_choosing import AllowedMakers, label_of
from frida_painter_studio.side_jobs import imagine
from frida_painter_studio.studio_folder import PaintingRequest
from frida_painter_studio.workers import WorkerSlot
from frida_painter_together.commands import Role
from frida_painter_together.proposing import plain_fact
from frida_painter_words.picture_makers import making as picture_making
from killing import call_here
from picture_makers.test_service import open_service, sends
from support.studio import Studio, Visitor

PAINTER = """
import struct, sys, zlib
words, seed, out = sys.argv[1:]
part = lambda kind, data: struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
rows = b"".join(b"\\0" + b"".join(bytes((9 * int(seed) % 256, 5 * x, 5 * y)) for x in range(40)) for y in range(30))
head = struct.pack(">IIBBBBB", 40, 30, 8, 2, 0, 0, 0)
parts = part(b"IHDR", head) + part(b"IDAT", zlib.compress(rows)) + part(b"IEND", b"")
open(out, "wb").write(b"\\x89PNG\\r\\n\\x1a\\n" + parts)
"""
"""A program that needs no package, so that it starts at once."""


@dataclass
class Stop:
    """A stop that is pressed, or not."""

    asked: bool = False

    def heed(self) -> None:
        if self.asked:
            raise StopPressed


@pytest.fixture(autouse=True)
def without_networks(monkeypatch: pytest.MonkeyPatch) -> None:
    """No network compares pictures with words, and no worker starts by itself."""

    def refuse(**known: Any) -> None:
        raise ConfigError("None is here.")

    monkeypatch.setattr(picture_making, "EncoderRegistry", refuse)
    monkeypatch.setattr(WorkerSlot, "start", lambda self, job, plan: None)


@pytest.fixture
def service() -> Iterator[str]:
    """The address of a service that answers with the page of another program."""
    with open_service() as server:
        server.answer = sends(b"<!DOCTYPE html><html>Sign in</html>", "text/html")
        yield f"http:http://{server.host}/picture?key=secret"


def program(folder: Path, source: str) -> str:
    (folder / "painter.py").write_text(source)
    return f"command:{sys.executable} {folder / 'painter.py'} {{words}} {{seed}} {{out}}"


def opened(folder: Path, *makers: str, minutes: float = 1.0) -> Studio:
    return Studio(folder / "store", makers=AllowedMakers({label_of(maker): maker for maker in makers}, minutes))


def make(studio: Studio, visitor: Visitor, stop: Stop | None = None, **more: Any) -> str:
    """Has pictures made, and returns the sentence about what went wrong, if anything did."""
    (maker,) = studio.web.makers.by_label
    answer = visitor.post("/api/imagining/start", json={"words": "a red tower", "maker": maker, "seed": 3, **more})
    assert answer.status_code == 200, answer.text
    folder = studio.store.job("imagining")
    feed = Feed(folder.path)
    try:
        imagine(folder, feed, stop or Stop())  # type: ignore[arg-type]
    except FridaError as fault:
        return str(fault)
    finally:
        feed.close()
    return ""


def test_pictures_are_made_chosen_and_their_record_follows_them(tmp_path: Path) -> None:
    studio = opened(tmp_path, program(tmp_path, PAINTER))
    visitor = studio.visitor(Role.plan)
    assert visitor.get("/api/studio").json()["makers"] == [f"command: {Path(sys.executable).name} painter.py"]
    assert make(studio, visitor) == ""
    assert make(studio, visitor, seed=7) == ""
    state = visitor.get("/api/imagining").json()
    assert [[one["seed"] for one in each["pictures"]] for each in state["makings"]] == [[3, 4, 5, 6], [7, 8, 9, 10]]
    assert str(tmp_path) not in json.dumps(state) and "painter.py" in state["makings"][0]["maker"]
    shown = state["makings"][1]["pictures"][1]["picture"]
    assert visitor.get(f"/api/imagining/files/{shown}").status_code == 200
    taken = visitor.post("/api/imagining/choose", json={"picture": shown}).json()
    assert taken["made"].startswith("Made from “a red tower” by command") and taken["made"].endswith(", seed 8")
    goal = {"kind": "image", "picture": taken["id"], "made": taken["made"]}
    begun = visitor.post("/api/paintings", json={"terms": [goal], "strokes": 5})
    entry = studio.store.find(begun.json()["id"])
    assert entry is not None
    plan = entry.folder.plan(1)
    assert plan.request().terms[0].made == taken["made"]
    spec = RunSpec.of(**plan.request().goals(plan.path))
    ((label, fact),) = making_facts(*spec.goal, *spec.initial)
    assert label == "Made" and "a-red-tower-2.png from “a red tower” by command" in fact and fact.endswith("seed 8")
    gone = visitor.post("/api/imagining/choose", json={"picture": "made-0.jpg"})
    assert gone.status_code == 422 and gone.json()["sentence"] == "This picture is gone; make pictures again."


@pytest.mark.parametrize(
    ("source", "minutes", "says"),
    [
        ("import sys; sys.exit('out of paint')", 1.0, "status 1 and made no picture; it said: out of paint"),
        ("import time; time.sleep(60)", 0.01, "was not finished after 1 s"),
    ],
    ids=["fails", "hangs"],
)
def test_a_maker_that_fails_is_one_sentence_on_the_page(tmp_path: Path, source: str, minutes: float, says: str) -> None:
    studio = opened(tmp_path, program(tmp_path, source), minutes=minutes)
    sentence = make(studio, studio.visitor())
    assert says in sentence and "\n" not in sentence
    assert not list((studio.store.job("imagining").path / "made").iterdir())


def test_a_service_that_answers_with_a_page_is_one_sentence_and_its_key_is_not_shown(
    tmp_path: Path, service: str
) -> None:
    studio = opened(tmp_path, service)
    sentence = make(studio, studio.visitor())
    assert "127.0.0.1" in sentence and "\n" not in sentence and "secret" not in sentence
    shown = json.dumps([studio.visitor().get(f"/api/{name}").json() for name in ("studio", "imagining")])
    assert "http: 127.0.0.1" in shown and "secret" not in shown


def test_a_stop_ends_the_making_alone(tmp_path: Path) -> None:
    studio = opened(tmp_path, program(tmp_path, "import time; time.sleep(60)"))
    visitor = studio.visitor()
    with pytest.raises(StopPressed):
        make(studio, visitor, Stop(asked=True))
    assert visitor.post("/api/imagining/stop").status_code == 200
    assert not studio.store.job("imagining").stop.exists(), "nothing is at work"


def test_none_is_allowed_by_default(tmp_path: Path) -> None:
    studio = Studio(tmp_path / "store")
    assert studio.visitor().get("/api/studio").json()["makers"] == []
    asked = {"words": "a hat", "maker": "command: true"}
    assert studio.visitor(Role.watch).post("/api/imagining/start", json=asked).status_code == 403
    answer = studio.visitor().post("/api/imagining/start", json=asked)
    assert answer.status_code == 422 and "whoever starts the studio allows one with --imagine" in answer.text


def test_makers_are_opened_once_before_the_page_and_have_labels_of_their_own(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(OwnProcess, "__call__", call_here)
    allowed = AllowedMakers.check(["command:true", "command:true {words}", "http://here:80/x?key=1"], 5.0)
    assert list(allowed.by_label) == ["command: true", "command: true (2)", "http: here"] and allowed.minutes == 5.0
    with pytest.raises(ConfigError, match="--imagine 'crystal:ball': There is no picture maker called 'crystal'"):
        AllowedMakers.check(["crystal:ball"], 5.0)


@pytest.mark.parametrize(
    ("maker", "label"),
    [
        ("diffusers:stabilityai/sd-turbo,steps=2", "diffusers: sd-turbo"),
        ("command:/usr/bin/python /home/me/draw.py --style oil", "command: python draw.py"),
        ("command:my-maker {words}", "command: my-maker"),
        ("http:http://me.local:7860/picture?key=1", "http: me.local"),
        ("own", "own"),
    ],
)
def test_a_label_tells_no_folder_and_no_setting(maker: str, label: str) -> None:
    assert label_of(maker) == label
    assert plain_fact("/usr/bin/python /home/me/draw.py '{words}'") == "python draw.py '{words}'"
    assert plain_fact("http://me.local/picture") == "http://me.local/picture"


def test_names_and_limits_are_those_of_the_making() -> None:
    """They stand twice, since the studio's own process loads no tensors."""
    assert studio_folder.MAKING_SUFFIX.removeprefix(".") == picture_making.MAKING
    assert studio_command.MAX_MINUTES == picture_making.MAX_MINUTES
    assert studio_command.USUAL_MINUTES == picture_making.USUAL_MINUTES == AllowedMakers().minutes
    assert PaintingRequest.model_validate({"terms": [{"kind": "text", "words": "a sea"}]}).terms[0].made is None
