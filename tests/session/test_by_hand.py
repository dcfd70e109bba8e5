from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import pytest
import torch

from frida_painter.brush.kinds import MEDIUM
from frida_painter.errors import Interrupted, RobotStopped
from frida_painter.hardware.camera import Frame
from frida_painter.hardware.drivers.human import HumanRobot
from frida_painter.hardware.easel import Easel
from frida_painter.session.attendance import NobodyAttending, PersonAttending
from frida_painter.session.brushwork import Brushwork
from frida_painter.session.by_hand import ByHand
from frida_painter.session.easels import EaselOrder, open_easel
from frida_painter.session.procedures.dialogue import Answer, Confirm, Question
from plans import CANVAS, made_up_plan

PLAN = made_up_plan(6, 2)


@dataclass
class Person:
    """Says yes, unless asked for what `refuses` names."""

    refuses: str = "never"
    asked: list[Confirm] = field(default_factory=list)

    def answer(self, question: Question) -> Answer:
        assert isinstance(question, Confirm)
        self.asked.append(question)
        return self.refuses not in question.text


@dataclass
class Snapshot:
    """A camera whose photograph is the canvas in one colour, from corner to corner."""

    shade: int = 200
    now: float = 0.0

    def connect(self) -> None: ...

    def close(self) -> None: ...

    def capture(self, newer_than: float) -> Frame:
        return Frame(np.full((200, 300, 3), self.shade, np.uint8), newer_than + 1, 1)


@pytest.fixture
def easel(tmp_path: Path) -> Easel:
    order = EaselOrder("human", CANVAS, "medium", 0, tmp_path, camera=f"folder:{tmp_path}")
    easel = open_easel(order).easel
    assert isinstance(easel.robot, HumanRobot)
    known = replace(
        easel.calibration, corners=((0.0, 0.0), (299.0, 0.0), (299.0, 199.0), (0.0, 199.0)), photograph=(200, 300)
    )
    return replace(easel, camera=Snapshot(), calibration=known)


def painting(easel: Easel, person: Person) -> tuple[Brushwork, ByHand]:
    hand = ByHand(easel, person.answer)
    hand.connect()
    hand.fill_wells(PLAN.palette)
    return Brushwork(replace(easel, robot=hand, camera=hand.camera, attendant=hand), MEDIUM), hand


def test_every_stroke_and_every_dip_is_asked_for_in_order(easel: Easel) -> None:
    person = Person()
    brushwork, _ = painting(easel, person)
    for action in brushwork.prepare(PLAN, 0, 6):
        brushwork.perform(action)
    brushwork.step_aside()
    texts = [question.text for question in person.asked]
    assert texts[0].startswith("Mix these paints") and "2 #" in texts[0]
    assert texts[1].startswith("Dip the brush into paint 1 (#")
    strokes = [text for text in texts if text.startswith("Stroke ")]
    assert [text.split(":")[0] for text in strokes] == [
        f"Stroke {n} with paint {1 + (n > 3)}" for n in range(1, 7)
    ]  # fmt: skip
    x, y = (100 * PLAN.strokes.position[0]).tolist()
    assert f"begin {x:.1f} cm from the left and {y:.1f} cm from the bottom" in strokes[0]
    second = next(text for text in texts if "into paint 2" in text)
    assert second.startswith("Clean the brush, and dip it into paint 2")
    assert "hands, brush and shadow" in texts[-1]
    assert all(question.picture is not None for question in person.asked if question.text.startswith("Stroke "))


def test_the_sheet_shows_the_canvas_as_it_was_last_seen_and_the_stroke_in_its_colour(easel: Easel) -> None:
    person = Person()
    brushwork, hand = painting(easel, person)
    brushwork.step_aside()
    hand.camera.capture(0.0)
    action = brushwork.prepare(PLAN.part(slice(1)), 0, 1)
    for one in action:
        brushwork.perform(one)
    picture = person.asked[-1].picture
    assert picture is not None and picture.shape[0] == 3 and picture.shape[1] > 720
    faded = 1 - (1 - 200 / 255) * 0.45
    assert (picture - faded).abs().amax(0).lt(0.01).float().mean() > 0.5
    color = PLAN.strokes.color[0][:, None, None]
    assert (picture - color).abs().amax(0).lt(0.01).sum() > 84 * 84 * 0.9


@pytest.mark.parametrize("word", ["Stroke 2", "paint 2", "Mix", "photographed"])
def test_who_says_no_ends_it_and_what_was_not_done_is_not_reported(easel: Easel, word: str) -> None:
    person = Person(refuses=word)
    with pytest.raises(Interrupted):
        brushwork, _ = painting(easel, person)
        for action in brushwork.prepare(PLAN, 0, 6):
            brushwork.perform(action)
        brushwork.step_aside()
    assert person.asked[-1].text.count(word)


def test_after_a_stop_nothing_more_is_taken_note_of(easel: Easel) -> None:
    brushwork, hand = painting(easel, Person())
    hand.stop()
    with pytest.raises(RobotStopped):
        brushwork.step_aside()
    hand.close()


def test_a_person_beside_a_real_robot_is_asked_to_fill_the_wells() -> None:
    person = Person()
    attending = PersonAttending(person.answer)
    attending.fill_wells(PLAN.palette)
    picture = person.asked[0].picture
    assert picture is not None and torch.equal(picture[:, 0, 0], PLAN.palette.color[0])
    assert not (attending.lay_paper() or attending.lay_checker() or attending.take_checker_away())
    nobody = NobodyAttending()
    nobody.fill_wells(PLAN.palette)
    assert not (nobody.lay_paper() or nobody.lay_checker() or nobody.take_checker_away())
