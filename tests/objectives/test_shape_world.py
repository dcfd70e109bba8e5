"""A CLIP that knows a small world gets from sentences that it never saw to the right pictures.

`tests/shape_world` holds the world, the CLIP (`eye`) and a judge that shares neither its
architecture nor its drawings.
"""

import random
from dataclasses import replace
from pathlib import Path

import pytest
import torch

from frida_painter.objectives.encoders.clip import Clip
from frida_painter.runs.goals import open_goal
from frida_painter.runs.settle import fit_canvas, settle
from frida_painter.runs.spec import RunSpec
from shape_world import judge, world

FOLDER = Path(world.__file__).parent
ASKED = [world.read(sentence) for sentence in (FOLDER / "prompts.txt").read_text().splitlines()]


def draw(pictures: list[world.Picture], *, spoiled: float = 0.0) -> torch.Tensor:
    chance = random.Random(5)
    layouts = [world.lay_out(picture, chance, spoiled) for picture in pictures]
    return world.draw(layouts, 6, world.make_stroke_fields(7, judge.SIDE, 12))


def test_the_judge_sees_what_is_there_and_nothing_else() -> None:
    reader, drawn = judge.load(FOLDER / "judge.safetensors"), draw(3 * ASKED)
    approved = torch.tensor([[reader.approves(one, asked) for asked in ASKED] for one in drawn]).float()
    own = approved[torch.arange(60), torch.arange(60) % 20]
    assert own.mean() >= 0.9
    assert approved.sum() == own.sum()  # never another of the sentences
    spoiled = draw(3 * ASKED, spoiled=1.0)
    assert sum(reader.approves(one, ASKED[at % 20]) for at, one in enumerate(spoiled)) <= 15


def test_the_eye_finds_the_sentence_of_a_drawing_among_twenty() -> None:
    eye = Clip.load(FOLDER / "eye")
    words = torch.stack([eye.embed_text(picture.say()) for picture in ASKED])
    found = (eye.embed_pictures(draw(3 * ASKED)) @ words.T).argmax(1)
    assert (found == torch.arange(60) % 20).float().mean() >= 0.9


def test_the_eye_reads_the_order_of_words() -> None:
    eye, chance = Clip.load(FOLDER / "eye"), random.Random(8)
    said = [picture for picture in (world.choose_picture(chance) for _ in range(400)) if picture.is_kept_aside]
    for one in [picture for picture in said if picture.other is not None][:20]:
        words = eye.embed_text(one.say())
        reverse = replace(one, relation=world.RELATIONS[one.relation])
        assert words @ eye.embed_text(one.turn().say()) > 0.99 > words @ eye.embed_text(reverse.say())


@pytest.mark.parametrize("number", [0, 6, 16])
def test_words_become_the_painting_that_they_say(number: int) -> None:
    spec = RunSpec.of(
        goal=[{"text": ASKED[number].say()}], clip=str(FOLDER / "eye"), strokes=80, canvas="30x30cm", colors=6,
        render_height=96, effort=0.2, beginning="colors",
    )  # fmt: skip
    _, planner, _ = settle(fit_canvas(spec, open_goal(spec)))
    painted, reader = planner.expected(planner.plan()), judge.load(FOLDER / "judge.safetensors")
    assert reader.approves(painted, ASKED[number]), reader.tell(painted)
