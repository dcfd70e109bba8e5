import os
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
import torch

from frida_painter.easel.dialogue import Confirm, Jog, JogMove, Measure, PointCorners, SetupQuestion, lead
from frida_painter.errors import Interrupted
from frida_painter.system.operating_system import is_typed
from frida_painter_cli.terminal import Terminal

PICTURE = torch.full((3, 20, 30), 0.5)
CORNERS = ((1.0, 2.0), (28.0, 2.5), (27.0, 18.0), (0.0, 17.0))


class Script:
    """A person who types these lines, and what they were told."""

    def __init__(self, folder: Path, *lines: str) -> None:
        self._lines: Iterator[str] = iter(lines)
        self.told: list[str] = []
        self.prompts: list[str] = []
        self.terminal = Terminal(self._type, self.told.append, folder)

    def _type(self, prompt: str) -> str:
        self.prompts.append(prompt)
        line = next(self._lines, None)
        if line is None:
            raise EOFError
        return line

    @property
    def is_over(self) -> bool:
        return next(self._lines, None) is None


@pytest.mark.parametrize(
    ("line", "proposal", "answer"),
    [("y", False, True), ("Yes", False, True), ("n", True, False), ("", True, True), ("", False, False)],
)
def test_yes_and_no(tmp_path: Path, line: str, proposal: bool, answer: bool) -> None:
    script = Script(tmp_path, line)
    assert script.terminal.answer(Confirm("Is it dry?", PICTURE, proposal)) is answer
    assert script.told[0] == "Is it dry?"
    assert script.prompts == ["[Y/n] " if proposal else "[y/N] "]
    assert (tmp_path / "question.png").exists()


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no such terminals")
@pytest.mark.parametrize(
    "question", [Confirm("Is it dry?"), PointCorners("Where?", PICTURE, CORNERS), Measure("?", 0, 1, 0.5)]
)
def test_an_enter_that_was_typed_before_a_question_accepts_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, question: SetupQuestion
) -> None:
    keyboard, screen = os.openpty()
    with os.fdopen(screen, "r") as terminal:
        monkeypatch.setattr(sys, "stdin", terminal)
        os.write(keyboard, b"\n")
        assert is_typed(terminal.fileno(), 10)
        Script(tmp_path, "").terminal.answer(question)
        assert not is_typed(terminal.fileno(), 0)
    os.close(keyboard)


def test_what_cannot_be_understood_is_asked_again(tmp_path: Path) -> None:
    script = Script(tmp_path, "perhaps", "2", "n")
    assert script.terminal.answer(Confirm("Ready?")) is False
    assert script.told[1:] == ["Type y or n.", "Type y or n."]


def test_corners_are_typed_or_taken_as_proposed(tmp_path: Path) -> None:
    question = PointCorners("Where?", PICTURE, CORNERS)
    assert Script(tmp_path, "").terminal.answer(question) == CORNERS
    script = Script(tmp_path, "1,2", "1,2 28,x 3,4 5,6", "1, 2  28,2.5  27,18  -0.5,17")
    assert script.terminal.answer(question) == ((1.0, 2.0), (28.0, 2.5), (27.0, 18.0), (-0.5, 17.0))
    assert len([line for line in script.told if "eight numbers" in line]) == 2
    assert "28.0,2.5" in script.prompts[0]


def test_without_a_proposal_corners_must_be_typed(tmp_path: Path) -> None:
    script = Script(tmp_path, "", "1 2 3 4 5 6 7 8")
    assert script.terminal.answer(PointCorners("Where?", PICTURE, None)) == ((1, 2), (3, 4), (5, 6), (7, 8))
    assert "only Enter" not in script.told[-1]


@pytest.mark.parametrize(
    ("line", "move"),
    [
        ("u", JogMove(0.001)),
        ("d", JogMove(-0.001)),
        ("uu", JogMove(0.005)),
        ("-", JogMove(-0.0002)),
        ("-1.5", JogMove(-0.0015)),
        ("ok", JogMove(settled=True)),
    ],
)
def test_jog_keys(tmp_path: Path, line: str, move: JogMove) -> None:
    answer = Script(tmp_path, line).terminal.answer(Jog("Lower it", 0.12, 0.10, 0.15))
    assert isinstance(answer, JogMove) and answer.settled == move.settled
    assert answer.step == pytest.approx(move.step)


def test_the_brush_is_not_jogged_out_of_bounds(tmp_path: Path) -> None:
    script = Script(tmp_path, "dd", "-100", "u", "")
    assert script.terminal.answer(Jog("Lower it", 0.101, 0.10, 0.15)) == JogMove(0.001)
    assert script.told[1:] == [script.told[1]] * 2 and "from 100.0 to 150.0 mm" in script.told[1]
    proposed = JogMove(-0.003)
    with pytest.raises(Interrupted):  # Enter moves nothing (M32)
        script.terminal.answer(Jog("Lower it", 0.12, 0.10, 0.15, proposal=proposed))


@pytest.mark.parametrize(("line", "metres"), [("31", 0.031), ("3.1 cm", 0.031), ("31mm", 0.031), ("", 0.02)])
def test_lengths(tmp_path: Path, line: str, metres: float) -> None:
    script = Script(tmp_path, "far", "9999", line)
    assert script.terminal.answer(Measure("How long?", 0.0, 0.5, 0.02)) == pytest.approx(metres)
    assert script.told[1:] == ["Type millimetres, from 0 to 500."] * 2


def test_a_whole_dialogue_is_led_and_may_be_left(tmp_path: Path) -> None:
    def lower():
        height = 0.12
        while True:
            move = yield Jog("Lower the brush until it touches.", height, 0.1, 0.15)
            if move.settled:
                return height
            height += move.step

    script = Script(tmp_path, "d", "d", "what", "+", "ok")
    assert lead(lower(), script.terminal.answer) == pytest.approx(0.1182)
    assert script.is_over
    with pytest.raises(Interrupted, match="what was done before is kept"):
        lead(lower(), Script(tmp_path, "d").terminal.answer)
