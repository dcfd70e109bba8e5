"""Painting together by words at the terminal: the talk of a pause, and of one that broke off."""

import io
import json
import os
import sys
from collections.abc import Iterator
from copy import deepcopy
from dataclasses import dataclass, field
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from frida_painter.errors import ConfigError, Interrupted
from frida_painter.session.events import Event, MadePictures, Paused, Remark, StrokePainted
from frida_painter.session.fold import PaintingState
from frida_painter.session.journal import Journal
from frida_painter.system import images
from frida_painter.system.event_log import EventLog
from frida_painter_cli.options import ask_at_terminal, read_line, require_proposer
from frida_painter_together import proposing
from frida_painter_together.commands import Propose
from frida_painter_together.conductor import Conductor
from frida_painter_together.inbox import MakingOrder
from frida_painter_together.proposing import Proposer
from support.planning import picture
from support.session import SessionSetup

WAVE = "command:sh -c 'cp wave.png $1' sh {out} {canvas} {words}"


@dataclass
class Terminal:
    """A person who types these lines in the pause after two strokes of six."""

    folder: Path
    lines: list[str]
    maker: str = WAVE
    history: PaintingState | None = None
    asked: list[str] = field(default_factory=list)
    own: tuple[bool, bool] | None = None  # if not None, their paint is found: they are asked about it, and it stays

    def ask(self, prompt: str) -> str:
        self.asked.append(prompt)
        if not self.lines:
            raise EOFError
        return self.lines.pop(0)

    def paint(self, journal: Journal) -> SessionSetup:
        known = deepcopy(self.history)  # it goes on with the journal

        def pause_at(event: Event) -> bool:
            return isinstance(event, StrokePainted) and event.done == 2

        def go_on(paused: Paused) -> bool:
            run = SimpleNamespace(session=setup.session, folder=self.folder, painting=journal.state, history=known)
            talk = Proposer(run, self.maker, self.ask)  # type: ignore[arg-type]

            def elsewhere(paused: Paused) -> bool | None:
                command = talk.find_command()
                return True if command is None else conductor.do(command)

            def hear(event: Event) -> None:
                if isinstance(event, Remark):  # as the line at the terminal shows it
                    print(event.sentence, file=sys.stderr)
                setup._hear(event)

            conductor = Conductor(self.folder, hear, lambda: False, 0.0, lambda: setup.session, elsewhere=elsewhere)
            if self.own is not None:
                conductor.asks_here, stays = self.own
                conductor.ask = lambda question: self.asked.append(question.text) or stays  # type: ignore[func-returns-value]
                setup.session.person.find_own_paint = lambda: np.arange(48).reshape(6, 8) % 8 < 2  # type: ignore[method-assign]
            if known is not None:
                journal.state.wishes.proposed = (
                    journal.state.wishes.proposed or known.wishes.proposed
                )  # as before the first stroke
                conductor.owe(known.wishes.request, known.wishes.proposed)
            return conductor.go_on(paused)

        setup = SessionSetup(6, replans=0, pause_at=pause_at, go_on=go_on, journal=journal)
        try:
            assert setup.run().painted == 6
        finally:
            journal.close()
        return setup


@pytest.fixture
def pursued(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Names of the pictures that became a goal; the maker finds its picture here."""
    images.save(picture(60, 80), tmp_path / "wave.png")
    monkeypatch.chdir(tmp_path)
    names: list[str] = []
    monkeypatch.setattr(proposing, "pursue", lambda session, folder, spec, wish: names.append(spec.goal[0].path.name))
    return names


def kinds(folder: Path) -> list[str]:
    wanted = ("command_taken", "command_done")
    return [str(entry["kind"]) for entry in EventLog.read(folder / "journal") if entry["kind"] in wanted]


def test_a_person_says_what_shall_change_and_chooses_one_picture_or_none(
    tmp_path: Path, pursued: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    lines = ["a calm sea", "", "make it a stormy sea 🌊", "9", "2", ""]
    Terminal(tmp_path, lines).paint(Journal.begin(tmp_path, {}, {}))
    assert pursued == ["make-it-a-stormy-sea-water-wave-2.png"] and lines == []
    asked, made = "command_taken", "command_done"
    assert kinds(tmp_path) == [asked, made, asked, asked, made, asked, asked, asked]
    record = json.loads((tmp_path / "changes" / "2" / "making.json").read_text())
    assert record["because"] == "a person chose it" and record["chosen"] == pursued[0] and "canvas" in record
    assert record["words"] == "make it a stormy sea water wave"
    assert "changes/2/make-it-a-stormy-sea-water-wave-2.png  (seed" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "maker", "says"),
    [
        ("a storm", "command:sh -c 'exit 3' sh {canvas}", "status 3"),
        ("\u200b", WAVE, "no words"),
        (10_001 * "x", WAVE, "at most 10000"),
        ("a\x1bstorm", WAVE, "control character"),
    ],
)
def test_each_trouble_is_one_sentence_and_the_painting_goes_on(
    tmp_path: Path, pursued: list[str], capsys: pytest.CaptureFixture[str], words: str, maker: str, says: str
) -> None:
    Terminal(tmp_path, [words, ""], maker).paint(Journal.begin(tmp_path, {}, {}))
    said = [line for line in capsys.readouterr().err.splitlines() if says in line]
    assert len(said) == 1 and pursued == []


@pytest.mark.parametrize("broke_off", ["asked", "made", "chosen"])
def test_a_talk_that_broke_off_goes_on_from_there(tmp_path: Path, pursued: list[str], broke_off: str) -> None:
    MakingOrder(words="a storm", maker=WAVE, label="command", minutes=1).keep(tmp_path)
    if broke_off != "asked":
        with pytest.raises(Interrupted):
            Terminal(tmp_path, ["a storm", *(["3"] if broke_off == "chosen" else [])]).paint(
                Journal.begin(tmp_path, {}, {})
            )
    else:
        Journal.begin(tmp_path, {}, {}).close()
    journal, history = Journal.reopen(tmp_path)
    told: dict[str, Any] = {
        "asked": {"kind": "propose", "words": "a storm", "maker": "command"},
        "made": {},
        "chosen": {"kind": "choose", "file": "changes/1/a-storm-3.png"},
    }
    history.wishes.request = told[broke_off]
    history.wishes.proposed = None if broke_off == "asked" else history.wishes.proposed
    pursued.clear()
    lines = {"asked": ["1", ""], "made": ["3", ""], "chosen": []}[broke_off]
    Terminal(tmp_path, lines, history=history).paint(journal)
    assert pursued == [f"a-storm-{1 if broke_off == 'asked' else 3}.png"]


def test_a_maker_that_cannot_be_used_is_refused_before_anything_is_painted() -> None:
    require_proposer(None, together=True)
    for maker, together, says in (
        (WAVE, True, "--together has none"),
        ("command:true", False, "is not given the canvas"),
    ):
        with pytest.raises(ConfigError, match=says):
            require_proposer(maker, together=together)


@pytest.fixture
def typing(monkeypatch: pytest.MonkeyPatch) -> Iterator[int]:
    """The end of a terminal at which a test types; the other end is this process's standard input."""
    keyboard, screen = os.openpty()
    with os.fdopen(screen, encoding="utf-8", errors="strict") as stdin:
        monkeypatch.setattr("sys.stdin", stdin)
        yield keyboard
    os.close(keyboard)


def test_what_is_typed_in_another_encoding_is_read(typing: int) -> None:
    os.write(typing, "une mer agit\u00e9e\n".encode("latin-1"))
    assert read_line() == "une mer agit\N{REPLACEMENT CHARACTER}e\n"
    os.write(typing, "une mer agit\u00e9e\n".encode())
    assert ask_at_terminal("What? ", lambda: False) == "une mer agit\u00e9e\n"


def test_the_end_of_typing_says_no_more_than_enter(typing: int) -> None:
    os.write(typing, b"\x04")
    assert ask_at_terminal("What? ", lambda: False) == ""


def test_a_stop_ends_a_question(typing: int) -> None:
    with pytest.raises(Interrupted):
        ask_at_terminal("What? ", lambda: True)


def test_pictures_that_people_at_a_page_have_asked_for_are_theirs_to_choose_from(typing: int, tmp_path: Path) -> None:
    painting = PaintingState()
    made = MadePictures("a storm", "boats", [{"file": "x", "seed": 1}], 0, "", [])
    painting.wishes.proposed, painting.wishes.paused = made, True
    progress = SimpleNamespace(so_far=SimpleNamespace(rest=[1]))
    run: Any = SimpleNamespace(session=progress, folder=tmp_path, painting=painting, history=painting)
    lines = ["a calm sea", ""]
    talk = Proposer(run, WAVE, lambda prompt: lines.pop(0))
    assert not talk.has_word()
    os.write(typing, b"\n")
    assert talk.has_word() and talk.find_command() == Propose("a calm sea", "command")
    assert talk.has_word() and talk.find_command() is None and not talk.has_word()


def test_nobody_is_asked_if_nobody_can_type(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sys.stdin", io.StringIO())
    history = PaintingState()
    history.wishes.request = {"kind": "propose", "words": "a storm", "maker": "command"}
    run: Any = SimpleNamespace(session=None, folder=tmp_path, painting=history, history=history)
    assert not Proposer(run, WAVE, input).has_word()


@pytest.mark.parametrize("asks", [True, False])
@pytest.mark.parametrize("stays", [True, False])
def test_whoever_changes_it_at_the_terminal_says_if_their_paint_stays(
    tmp_path: Path, pursued: list[str], capsys: pytest.CaptureFixture[str], asks: bool, stays: bool
) -> None:
    person = Terminal(tmp_path, ["a storm", "", ""], own=(asks, stays))
    setup = person.paint(Journal.begin(tmp_path, {}, {}))
    assert [line for line in person.asked if "Shall it stay as it is?" in line] == asks * [
        "You painted about 25 % of the canvas. Shall it stay as it is?"
    ]
    assert (setup.session.journal.state.wishes.region is None) is (asks and not stays)
    assert ("press Remove the protection" in capsys.readouterr().err) is not asks


def test_what_is_not_proposed_cannot_be_chosen(
    tmp_path: Path, pursued: list[str], capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Proposer, "_choose", lambda *_: "changes/1/canvas.png")
    Terminal(tmp_path, ["a storm", ""]).paint(Journal.begin(tmp_path, {}, {}))
    said = capsys.readouterr().err
    assert "This picture is not proposed any more" in said and str(tmp_path) not in said and pursued == []
