import itertools

import torch
from hypothesis import given
from hypothesis import strategies as st

from frida_painter.planning.effort import Effort
from frida_painter.planning.initialize import layers, pick, progressive, propose, round_sizes, uniform, weigh
from frida_painter.planning.optimize import optimize
from frida_painter.planning.variables import Paints
from frida_painter.strokes.strokes import Strokes
from support.planning import CANVAS, problem, some_strokes, target

PROBLEM = problem(48)
TARGET = target(PROBLEM)
EFFORT = Effort(growing=4, growing_together=8, proposals=8)


def chance(seed: int = 0) -> torch.Generator:
    return torch.Generator().manual_seed(seed)


def judged(strokes: Strokes) -> float:
    with torch.no_grad():
        return float(PROBLEM.objective(PROBLEM.render(strokes)))


def grown(count: int, seed: int = 0, effort: Effort = EFFORT) -> Strokes:
    return progressive(count, PROBLEM, TARGET, effort, chance(seed))


@given(st.integers(0, 20_000), st.integers(1, 50))
def test_rounds_sum_up_exactly_grow_and_are_never_empty(count: int, rounds: int) -> None:
    sizes = round_sizes(count, rounds)
    assert sum(sizes) == count
    assert len(sizes) == min(rounds, count)
    assert all(size >= 1 for size in sizes)
    assert all(later >= earlier - 1 for earlier, later in itertools.pairwise(sizes))


def test_uniform_strokes_may_be_painted_and_use_the_whole_range() -> None:
    strokes = uniform(400, PROBLEM.limits, CANVAS, chance())
    strokes.check(PROBLEM.limits, CANVAS)
    (shortest, longest), reach = PROBLEM.limits.length, torch.tensor([CANVAS.width, CANVAS.height])
    assert strokes.length.min() < shortest + 0.001 and strokes.length.max() > longest - 0.001
    assert strokes.thickness.std() > 0.25 and strokes.angle.std() > 1.5
    assert bool((strokes.position.amin(0) < 0.1 * reach).all() and (strokes.position.amax(0) > 0.9 * reach).all())


def test_exactly_as_many_strokes_as_were_asked_for() -> None:
    for count in (0, 1, 2, 3, 32):
        strokes = grown(count, effort=Effort(growing=4, growing_together=2, proposals=4))
        assert len(strokes) == count
        strokes.check(PROBLEM.limits, CANVAS)


def test_strokes_are_placed_even_where_none_gains_any_more() -> None:
    few = Effort(growing=1, growing_together=0, proposals=4)
    assert len(progressive(7, PROBLEM, torch.ones_like(TARGET), few, chance())) == 7


def test_the_progressive_start_beats_the_uniform_one_at_as_many_iterations() -> None:
    """Measured after 32 iterations, four seeds: 0.044 to 0.047 of squared error against 0.062 to 0.089."""
    iterations = EFFORT.growing * EFFORT.growing_together
    for seed in range(2):
        start = uniform(24, PROBLEM.limits, CANVAS, chance(seed))
        settled, _ = optimize(start, PROBLEM, iterations=iterations)
        assert judged(grown(24, seed)) < 0.85 * judged(settled)


FINER = problem(96)
FINER_TARGET = target(FINER)


def squared_error(strokes: Strokes) -> float:
    with torch.no_grad():
        return float((FINER_TARGET - FINER.render(strokes)).square().sum())


def proposals(count: int, seed: int = 0) -> Strokes:
    error = (FINER_TARGET - FINER.canvas).square().sum(0)
    return propose(error, count, FINER.limits, CANVAS, torch.Generator().manual_seed(seed))


def test_proposals_may_be_painted_and_lie_where_the_error_is() -> None:
    found = proposals(500)
    found.check(FINER.limits, CANVAS)
    middle = found.path(torch.tensor([0.5]))[:, 0] / torch.tensor([CANVAS.width, CANVAS.height])
    on_disc = ((middle - torch.tensor([0.3, 0.6])).norm(dim=1) < 0.25).float().mean()
    assert on_disc > 0.35, "a third of the error is in the dark disc, which is an eighth of the picture"


def test_the_gain_of_a_stroke_on_a_blank_canvas_is_the_fall_of_the_squared_error() -> None:
    """The gain is summed over a coarse mark, which costs a few per cent."""
    under = layers(Strokes.empty(), FINER)
    gain, colored, _ = weigh(proposals(60), under, FINER_TARGET, None, FINER)
    bare = squared_error(Strokes.empty())
    fall = torch.tensor([bare - squared_error(colored[[number]]) for number in range(len(colored))])
    assert (gain - fall).abs().mean() < 0.05 * fall.abs().mean()
    assert abs(gain.sum() - fall.sum()) < 0.04 * fall.sum()


def test_a_proposal_takes_the_mean_colour_of_what_it_covers() -> None:
    under = layers(Strokes.empty(), FINER)
    _, colored, _ = weigh(proposals(10, seed=2), under, FINER_TARGET, None, FINER)
    with torch.no_grad():
        for number in range(10):
            black = colored[[number]].with_groups(color=torch.zeros(1, 3))
            covered = 1 - FINER.render(black)  # the canvas is white
            mean = (covered * FINER_TARGET).sum((1, 2)) / covered.sum((1, 2))
            assert (mean - colored.color[number]).abs().max() < 0.03


def test_the_gain_of_a_stroke_among_others_is_foreseen_where_it_will_lie_in_the_order() -> None:
    painted = some_strokes(12, seed=3)
    under = layers(painted, FINER)
    gain, colored, _ = weigh(proposals(60, seed=1), under, FINER_TARGET, None, FINER)
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
    under = layers(Strokes.empty(), FINER)
    _, colored, paint = weigh(proposals(40), under, FINER_TARGET, Paints(palette, torch.zeros(0).long()), FINER)
    assert paint is not None and torch.equal(colored.color, palette[paint])
    assert set(paint.tolist()) == {0, 1, 2}


def test_layers_know_what_lies_below_and_how_much_shines_through_from_above() -> None:
    painted = some_strokes(6)
    under = layers(painted, FINER)
    assert torch.equal(under.below[0], FINER.canvas)
    assert torch.allclose(under.below[-1], under.picture) and torch.allclose(under.picture, FINER.render(painted))
    assert bool((under.open[-1] == 1).all())
    assert bool((under.open.diff(dim=0) >= -1e-6).all()), "the higher a layer, the more of it is seen"


def test_picked_strokes_gain_most_and_keep_clear_of_each_other() -> None:
    found = proposals(80)
    gain = torch.rand(80, generator=torch.Generator().manual_seed(0)) - 0.3
    chosen = pick(found, gain, 6, FINER.model)
    assert 1 <= len(chosen) <= 6 and len(set(chosen.tolist())) == len(chosen)
    assert chosen[0] == gain.argmax() and bool((gain[chosen] > 0).all()) and bool((gain[chosen].diff() <= 0).all())
    assert len(pick(found, -gain.abs(), 6, FINER.model)) == 0
