from dataclasses import replace

import torch

from frida_painter.planning.initialize import layers, pick, propose, weigh
from frida_painter.planning.variables import Paints
from frida_painter.strokes import Strokes
from support.planning import CANVAS, problem, some_strokes, target

PROBLEM = problem(96)
TARGET = target(PROBLEM)


def squared_error(strokes: Strokes) -> float:
    with torch.no_grad():
        return float((TARGET - PROBLEM.render(strokes)).square().sum())


def proposals(count: int, seed: int = 0) -> Strokes:
    error = (TARGET - PROBLEM.canvas).square().sum(0)
    return propose(error, count, PROBLEM.limits, CANVAS, torch.Generator().manual_seed(seed))


def test_proposals_may_be_painted_and_lie_where_the_error_is() -> None:
    found = proposals(500)
    found.check(PROBLEM.limits, CANVAS)
    middle = found.path(torch.tensor([0.5]))[:, 0] / torch.tensor([CANVAS.width, CANVAS.height])
    on_disc = ((middle - torch.tensor([0.3, 0.6])).norm(dim=1) < 0.25).float().mean()
    assert on_disc > 0.35, "a third of the error is in the dark disc, which is an eighth of the picture"


def test_the_gain_of_a_stroke_on_a_blank_canvas_is_the_fall_of_the_squared_error() -> None:
    """The gain is summed over a coarse mark, which costs a few per cent."""
    under = layers(Strokes.empty(), PROBLEM)
    gain, colored, _ = weigh(proposals(60), under, TARGET, None, PROBLEM)
    bare = squared_error(Strokes.empty())
    fall = torch.tensor([bare - squared_error(colored[[number]]) for number in range(len(colored))])
    assert (gain - fall).abs().mean() < 0.05 * fall.abs().mean()
    assert abs(gain.sum() - fall.sum()) < 0.04 * fall.sum()


def test_gains_count_by_how_much_each_place_matters() -> None:
    matters = torch.linspace(0.1, 1.9, PROBLEM.canvas.shape[2]).expand(*PROBLEM.canvas.shape[1:])
    weighted = replace(PROBLEM, importance=matters)

    def error(strokes: Strokes) -> float:
        with torch.no_grad():
            return float((matters * (TARGET - PROBLEM.render(strokes)).square()).sum())

    gain, colored, _ = weigh(proposals(60), layers(Strokes.empty(), weighted), TARGET, None, weighted)
    fall = torch.tensor([error(Strokes.empty()) - error(colored[[number]]) for number in range(len(colored))])
    assert (gain - fall).abs().mean() < 0.06 * fall.abs().mean()


def test_a_proposal_takes_the_mean_colour_of_what_it_covers() -> None:
    under = layers(Strokes.empty(), PROBLEM)
    _, colored, _ = weigh(proposals(10, seed=2), under, TARGET, None, PROBLEM)
    with torch.no_grad():
        for number in range(10):
            black = colored[[number]].with_groups(color=torch.zeros(1, 3))
            covered = 1 - PROBLEM.render(black)  # the canvas is white
            mean = (covered * TARGET).sum((1, 2)) / covered.sum((1, 2))
            assert (mean - colored.color[number]).abs().max() < 0.03


def test_the_gain_of_a_stroke_among_others_is_foreseen_where_it_will_lie_in_the_order() -> None:
    painted = some_strokes(12, seed=3)
    under = layers(painted, PROBLEM)
    gain, colored, _ = weigh(proposals(60, seed=1), under, TARGET, None, PROBLEM)
    place = under.place_of(colored.color)
    before = squared_error(painted)
    fall = torch.tensor(
        [
            before - squared_error(Strokes.join(painted[:at], colored[[number]], painted[at:]))
            for number, at in enumerate(place.tolist())
        ]
    )
    assert set(place.tolist()) > {0, 12}
    assert (gain - fall).abs().mean() < 0.06 * fall.abs().mean()


def test_with_paints_every_proposal_takes_one_of_them() -> None:
    palette = torch.tensor([[0.9, 0.9, 0.8], [0.8, 0.2, 0.1], [0.1, 0.1, 0.3]])
    under = layers(Strokes.empty(), PROBLEM)
    _, colored, paint = weigh(proposals(40), under, TARGET, Paints(palette, torch.zeros(0).long()), PROBLEM)
    assert paint is not None and torch.equal(colored.color, palette[paint])
    assert set(paint.tolist()) == {0, 1, 2}


def test_layers_know_what_lies_below_and_how_much_shines_through_from_above() -> None:
    painted = some_strokes(6)
    under = layers(painted, PROBLEM)
    assert torch.equal(under.below[0], PROBLEM.canvas)
    assert torch.allclose(under.below[-1], under.picture) and torch.allclose(under.picture, PROBLEM.render(painted))
    assert bool((under.open[-1] == 1).all())
    assert bool((under.open.diff(dim=0) >= -1e-6).all()), "the higher a layer, the more of it is seen"


def test_picked_strokes_gain_most_and_keep_clear_of_each_other() -> None:
    found = proposals(80)
    gain = torch.rand(80, generator=torch.Generator().manual_seed(0)) - 0.3
    chosen = pick(found, gain, 6, PROBLEM.model)
    assert 1 <= len(chosen) <= 6 and len(set(chosen.tolist())) == len(chosen)
    assert chosen[0] == gain.argmax() and bool((gain[chosen] > 0).all()) and bool((gain[chosen].diff() <= 0).all())
    assert len(pick(found, -gain.abs(), 6, PROBLEM.model)) == 0
