from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import pytest
import torch

from frida_painter.brush.kinds import MEDIUM
from frida_painter.easel.dialogue import Answer, Confirm, Question
from frida_painter.easel.open import open_easel
from frida_painter.easel.operator import AbsentOperator, PersonAsOperator
from frida_painter.easel.order import EaselOrder
from frida_painter.errors import Interrupted, RobotStopped
from frida_painter.hardware.easel import Easel
from frida_painter.hardware.robot import Frame
from frida_painter.session.events import Dipped, StrokeLeftOut, StrokePainted
from frida_painter.session.hand import Hand
from frida_painter.session.human import ByHand, HumanRobot
from support.plans import CANVAS, made_up_plan

PLAN = made_up_plan(6, 2)


@dataclass
class Person:
    """Says yes, unless asked for what `refuses` names, or whether several strokes are to be shown."""

    refuses: str = "never"
    likes_several: bool = False
    asked: list[Confirm] = field(default_factory=list)

    def answer(self, question: Question) -> Answer:
        assert isinstance(question, Confirm)
        self.asked.append(question)
        if "one at a time" in question.text:
            return self.likes_several
        return not any(word in question.text for word in self.refuses.split("|"))


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
    order = EaselOrder("human", CANVAS, ("medium",), tmp_path, camera=f"folder:{tmp_path}")
    easel = open_easel(order).easel
    assert isinstance(easel.robot, HumanRobot)
    known = replace(
        easel.calibration, corners=((0.0, 0.0), (299.0, 0.0), (299.0, 199.0), (0.0, 199.0)), photograph=(200, 300)
    )
    return replace(easel, camera=Snapshot(), calibration=known)


def painting(easel: Easel, person: Person) -> tuple[Hand, ByHand]:
    hand = ByHand(easel, person.answer)
    hand.connect()
    hand.fill_wells(PLAN.palette)
    return Hand(replace(easel, robot=hand, camera=hand.camera, operator=hand, foretell=hand.foretell), MEDIUM), hand


def test_every_stroke_and_every_dip_is_asked_for_in_order(easel: Easel) -> None:
    person = Person()
    painting_hand, hand = painting(easel, person)
    for action in painting_hand.prepare(PLAN, 0, 6):
        painting_hand.perform(action)
    painting_hand.clean()
    painting_hand.step_aside()
    hand.camera.capture(0.0)
    painting_hand.step_aside()
    hand.camera.capture(1.0)
    texts = [question.text for question in person.asked]
    assert texts[0].startswith("Mix these paints") and "2 #" in texts[0]
    assert "one at a time" in texts[1]
    strokes = texts[2:8]
    assert all(f"Stroke {n} with paint {1 + (n > 3)}: begin" in text for n, text in enumerate(strokes, 1))
    assert strokes[0].startswith("Dip the brush into paint 1 (#")
    assert strokes[3].startswith("Wash the brush, wipe it dry and dip it into paint 2")
    x, y = (100 * PLAN.strokes.position[0]).tolist()
    assert f"begin {x:.1f} cm from the left and {y:.1f} cm from the bottom" in strokes[0]
    assert texts[8:] == ["Wash the brush and wipe it dry. Done?", texts[-1]], "and asked for the look once"
    assert "hands, brush and shadow" in texts[-1]
    assert all(question.picture is not None for question in person.asked[2:8])


def test_several_strokes_of_one_paint_are_shown_on_one_sheet_where_the_person_wants_that(easel: Easel) -> None:
    person = Person(refuses="Strokes 4 to 6", likes_several=True)
    painting_hand, _ = painting(easel, person)
    done = [painting_hand.perform(action) for action in painting_hand.prepare(PLAN, 0, 6)]
    texts = [question.text for question in person.asked[2:]]
    assert texts[0].startswith("Dip the brush into paint 1 (#") and "Strokes 1 to 3 with paint 1" in texts[0]
    assert "Strokes 4 to 6 with paint 2" in texts[1] and "Stroke 4 with" in texts[2], "the first alone, then"
    assert "Strokes 5 to 6" in texts[3] and len(texts) == 4
    assert [one.done for one in done if isinstance(one, StrokePainted)] == [1, 2, 3, 4, 5, 6]


def test_a_sheet_that_was_painted_is_not_asked_for_again_after_a_pause(easel: Easel) -> None:
    person = Person(likes_several=True)
    painting_hand, hand = painting(easel, person)
    for action in painting_hand.prepare(PLAN.part(slice(3)), 0, 6):
        if isinstance(painting_hand.perform(action), StrokePainted):
            break
    painting_hand.clean()
    painting_hand.step_aside()
    asked = len(person.asked)
    for action in painting_hand.prepare(PLAN.part(slice(1, 3)), 1, 6):
        painting_hand.perform(action)
    assert [question.text for question in person.asked[asked:]] == []
    painting_hand.step_aside()
    hand.camera.capture(0.0)
    assert "hands, brush and shadow" in person.asked[-1].text


def test_a_stroke_that_is_left_out_is_told_of_and_not_shown_as_painted(easel: Easel) -> None:
    person = Person(refuses="Stroke 2")
    painting_hand, _ = painting(easel, person)
    done = [painting_hand.perform(action) for action in painting_hand.prepare(PLAN.part(slice(3)), 0, 3)]
    assert [type(one) for one in done if not isinstance(one, Dipped)] == [StrokePainted, StrokeLeftOut, StrokePainted]
    assert "Is stroke 2 to be left out?" in [question.text.split(" (")[0] for question in person.asked]


def test_the_sheet_shows_the_canvas_as_it_was_last_seen_and_the_stroke_in_its_colour(easel: Easel) -> None:
    person = Person()
    painting_hand, hand = painting(easel, person)
    painting_hand.step_aside()
    hand.camera.capture(0.0)
    action = painting_hand.prepare(PLAN.part(slice(1)), 0, 1)
    for one in action:
        painting_hand.perform(one)
    picture = person.asked[-1].picture
    assert picture is not None and picture.shape[0] == 3 and picture.shape[1] > 720
    faded = 1 - (1 - 200 / 255) * 0.4
    assert (picture - faded).abs().amax(0).lt(0.01).float().mean() > 0.5
    color = PLAN.strokes.color[0][:, None, None]
    assert (picture - color).abs().amax(0).lt(0.01).sum() > 92 * 92 * 0.9


@pytest.mark.parametrize("word", ["Stroke 2|left out", "Mix", "Wash the brush and", "photograph"])
def test_who_says_no_ends_it_and_what_was_not_done_is_not_reported(easel: Easel, word: str) -> None:
    person = Person(refuses=word)
    with pytest.raises(Interrupted):
        painting_hand, _ = painting(easel, person)
        for action in painting_hand.prepare(PLAN, 0, 6):
            painting_hand.perform(action)
        painting_hand.clean()
        painting_hand.step_aside()
        painting_hand.easel.camera.capture(0.0)
    assert person.asked[-1].text.count(word.split("|")[-1])


def test_after_a_stop_nothing_more_is_taken_note_of(easel: Easel) -> None:
    painting_hand, hand = painting(easel, Person())
    hand.stop()
    with pytest.raises(RobotStopped):
        painting_hand.step_aside()
    hand.close()


def test_a_person_is_told_how_to_mix_the_ground_and_may_leave() -> None:
    person = Person()
    PersonAsOperator(person.answer).tone((0.784, 0.659, 0.471))
    (question,) = person.asked
    assert "#c8a878 (" in question.text and " titanium white + " in question.text
    assert question.picture is not None and question.picture.shape == (3, 150, 150)
    AbsentOperator().tone((0.5, 0.5, 0.5))
    with pytest.raises(Interrupted, match=r"not toned.*resume the painting"):
        PersonAsOperator(lambda question: False).tone((0.5, 0.5, 0.5))


def test_a_person_beside_a_real_robot_is_asked_to_fill_the_wells() -> None:
    person = Person()
    attending = PersonAsOperator(person.answer)
    attending.fill_wells(PLAN.palette)
    picture = person.asked[0].picture
    assert picture is not None and torch.allclose(picture[:, 0, 0], PLAN.palette.color[0], atol=0.003)
    assert not (attending.lay_paper() or attending.lay_checker() or attending.take_checker_away())
    nobody = AbsentOperator()
    nobody.fill_wells(PLAN.palette)
    assert not (nobody.lay_paper() or nobody.lay_checker() or nobody.take_checker_away())
