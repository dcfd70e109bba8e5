"""Share of sentences that become the right painting through a CLIP: one of the tests, which knows a small world.

    python benchmarks/words_in_a_world.py [--draw 7] [--sheet FILE] [--only 3 7] [--seed 0] [--clip FOLDER] [--quick]

Twenty sentences that no training saw (tests/shape_world/prompts.txt) are planned as a person would:
`--text "two blue balls on red ground" --clip FOLDER --beginning colors`. A judge of another architecture, seed and
training set reads first pictures and paintings. `--draw` takes twenty others that no training saw, drawn by a seed, so
that nobody can have tuned to them. The last line tells how many paintings it takes for another of the
twenty sentences: what chance would give.
"""

import argparse
import random
import sys
import time
from pathlib import Path

import torch
from torch import Tensor

from frida_painter import images
from frida_painter.runs.goals import open_goal
from frida_painter.runs.settle import open_planner, settle_ground
from frida_painter.runs.spec import RunSpec

HERE = Path(__file__).parents[1] / "tests" / "shape_world"
sys.path.insert(0, str(HERE.parent))

from shape_world import judge, world  # noqa: E402 (the tests are no package)

SETTINGS = {"strokes": 100, "canvas": "30x30cm", "colors": 6, "render_height": 96, "effort": 0.5,
            "beginning": "colors"}  # fmt: skip
_SHOWN = 96  # rows of a picture on the sheet
_ACROSS = 5  # sentences in a row of the sheet


def paint(sentence: str, clip: Path, seed: int, **settings: object) -> tuple[Tensor, Tensor]:
    """Returns the first picture and the expected painting of a sentence, [3, 96, 96] each."""
    spec = RunSpec.of(goal=[{"text": sentence}], clip=str(clip), seed=seed, **{**SETTINGS, **settings})
    planner = open_planner(spec, open_goal(spec))
    begun = next(term.picture for term in planner.goal.initial if term.picture is not None)
    planner, *_ = settle_ground(spec, planner)
    painted = planner.expected(planner.plan())
    return images.fit(begun, _SHOWN, _SHOWN), images.fit(painted, _SHOWN, _SHOWN)


def draw(seed: int, known: list[world.Picture]) -> list[world.Picture]:
    """Returns as many other pictures as are known, whose sentences no training saw."""
    chance, found = random.Random(seed), list[world.Picture]()
    meant = {picture.set_upright() for picture in known}
    while len(found) < len(known):
        picture = world.choose_picture(chance)
        if picture.is_kept_aside and picture.set_upright() not in meant:
            found.append(picture)
            meant.add(picture.set_upright())
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--draw", type=int, help="seed of twenty other sentences")
    parser.add_argument("--sheet", type=Path, help="write first pictures and paintings to this PNG")
    parser.add_argument("--only", type=int, nargs="+", help="numbers of sentences, from 0")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--clip", type=Path, default=HERE / "eye")
    parser.add_argument("--quick", action="store_true", help="a third of the effort")
    given = parser.parse_args()
    torch.set_num_threads(1)
    asked = [world.read(line) for line in (HERE / "prompts.txt").read_text().splitlines()]
    asked = asked if given.draw is None else draw(given.draw, asked)
    reader = judge.load(HERE / "judge.safetensors")
    quicker = {"effort": 0.2} if given.quick else {}
    painted: dict[int, Tensor] = {}
    pairs, begun_right = [], 0
    for number in given.only or range(len(asked)):
        started, picture = time.process_time(), asked[number]
        begun, painted[number] = paint(picture.say(), given.clip, given.seed, **quicker)
        pairs.append(torch.cat((begun, painted[number]), 2))
        begun_right += reader.approves(begun, picture)
        right = "right" if reader.approves(painted[number], picture) else "WRONG"
        print(
            f"{number}: {picture.say()}: {right}; the judge sees {reader.tell(painted[number])}; in the first picture "
            f"{reader.tell(begun)} ({time.process_time() - started:.0f} CPU s)",
            flush=True,
        )
    table = {at: [reader.approves(one, picture) for picture in asked] for at, one in painted.items()}
    right, others = sum(row[at] for at, row in table.items()), sum(sum(row) - row[at] for at, row in table.items())
    print(
        f"{right} of {len(table)} paintings are right, {begun_right} first pictures; for another sentence of the "
        f"{len(asked)}, the judge takes {others} of {len(table) * (len(asked) - 1)}."
    )
    if given.sheet is not None:
        blank = torch.ones_like(pairs[0])
        pairs += [blank] * (-len(pairs) % _ACROSS)
        rows = [torch.cat(pairs[first : first + _ACROSS], 2) for first in range(0, len(pairs), _ACROSS)]
        images.save(torch.cat(rows, 1), given.sheet)


if __name__ == "__main__":
    main()
