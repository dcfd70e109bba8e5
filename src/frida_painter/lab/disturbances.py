"""Experiment: paintings in which something goes wrong, with and without looks.

A painter who looks and replans should notice that strokes are missing, that a paint is mixed wrongly, that the canvas
was bumped, or that a person painted along, and make the best of it. Each disturbance meets the same first plan twice:
painted as it is, and with looks. Paintings without a disturbance stand beside them.

A person reacts as the program asks for it: a canvas that was bumped is put back to its marks when the painting pauses.
Without a look nobody notices anything.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from frida_painter import images
from frida_painter.hardware.easel import PersonStroke
from frida_painter.hardware.faults import Bump, Faults, PlacementError
from frida_painter.lab import paintings
from frida_painter.lab.paintings import (
    UNDISTURBED,
    Disturbance,
    MakePlan,
    OtherPaint,
    Painted,
    PaintingTrial,
    Tell,
)
from frida_painter.lab.targets import Target
from frida_painter.lab.trials import Experiment, Measurement, Outcome, Results, ResultTable, Row, psnr
from frida_painter.palette import Palette, difference, from_lab, to_lab
from frida_painter.plan import Plan
from frida_painter.report.sheets import Cell, FigureRow, page
from frida_painter.runs.run import PaintingRun
from frida_painter.runs.spec import RunSpec
from frida_painter.session.events import Paused
from frida_painter.virtual.studio import VirtualStudio

NAME = "disturbances"
LOOKING, BLIND = "with looks", "without looking"
WAYS = (BLIND, LOOKING)
SIMILARITY = "PSNR, dB"
FULL = RunSpec.of(strokes=100, colors=8, replans=6, canvas="20x16cm", render_height=128, effort=0.3)
QUICK = RunSpec.of(strokes=12, colors=3, replans=2, canvas="9x7cm", render_height=64, effort=0.05)
_LOST_SHARE = 0.05
_WRONG_BY = 8.0  # CIEDE2000
_BUMP = 0.003  # metres
_PUT_BACK = 0.0003  # metres; a canvas that a person puts back to its marks lies as near
_PERSON_STROKES = 5
_PERSON_LENGTH = 0.3  # share of the canvas's shorter side
_MIXES = 200  # colours that are tried


def disturbances(seed: int, strokes: int) -> tuple[Disturbance, ...]:
    """Returns the disturbances of a painting with this many strokes.

    seed: decides the lost strokes, the wrong paint, the direction of the bump and the person's strokes
    """
    return (
        UNDISTURBED,
        _lost_strokes(seed, strokes),
        Disturbance(f"a paint is wrong by {_WRONG_BY:g} CIEDE2000", lambda studio: _mix_wrongly(studio, seed)),
        _bump(seed, strokes),
        Disturbance(
            "a person's five strokes",
            lambda studio: _when_half_done(studio, strokes, lambda: _paint_along(studio, seed)),
            lambda studio, paused: True,
        ),
    )  # fmt: skip


def _lost_strokes(seed: int, strokes: int) -> Disturbance:
    """Returns the disturbance in which some strokes do not reach the canvas."""
    lost = _random(seed, 0).choice(strokes, max(1, round(_LOST_SHARE * strokes)), replace=False)
    faults = Faults(dropped_touches=frozenset(lost.tolist()))
    return Disturbance(f"{_LOST_SHARE:.0%} of the strokes are lost", lambda studio: studio.break_things(faults))


def _bump(seed: int, strokes: int) -> Disturbance:
    """Returns the disturbance in which the canvas is bumped at half-time; a person puts it back when asked."""
    direction, back = _random(seed, 1).uniform(0, 2 * math.pi, 2)
    faults = Faults(bumps=(Bump(strokes // 2, _vector(_BUMP, direction)),))

    def put_back(studio: VirtualStudio, paused: Paused) -> bool:
        studio.table.knock = PlacementError(_vector(_PUT_BACK, back), 0.0)
        return True

    name = f"the canvas is bumped by {1000 * _BUMP:g} mm"
    return Disturbance(name, lambda studio: studio.break_things(faults), put_back)


def _vector(length: float, direction: float) -> tuple[float, float]:
    return length * math.cos(direction), length * math.sin(direction)


def _mix_wrongly(studio: VirtualStudio, seed: int) -> None:
    """Has one paint of every filling of the wells mixed wrongly."""
    random = _random(seed, 2)

    def mix(wanted: Palette) -> Palette:
        color = wanted.color.clone()
        number = int(random.integers(len(color)))
        color[number] = wrong_color(color[number], _WRONG_BY, random)
        return Palette(color)

    studio.easel = replace(studio.easel, operator=OtherPaint(studio.easel.operator, studio.table, mix))


def wrong_color(color: Tensor, by: float, random: np.random.Generator) -> Tensor:
    """Returns a random colour at a distance of `by` (CIEDE2000) from an sRGB colour [3], inside sRGB."""
    nearest, off = color, math.inf
    for _ in range(_MIXES):
        way = torch.from_numpy(random.normal(size=3)).to(color)
        way, reach = way / way.norm(), torch.linspace(0.5, 4, 71)[:, None] * by
        tried = from_lab((to_lab(color) + reach * way).contiguous())
        apart = (difference(tried, color.expand_as(tried)) - by).abs()
        best = int(apart.argmin())
        if float(apart[best]) < off:
            nearest, off = tried[best], float(apart[best])
        if off <= 0.1:
            break
    return nearest


def _when_half_done(studio: VirtualStudio, strokes: int, act: Callable[[], None]) -> None:
    """Has something done once, after the motion that paints half of the strokes."""
    before, done = studio.table.note, False

    def note(entry: Any, *, flush: bool = False) -> None:
        nonlocal done
        before(entry, flush=flush)
        if not done and studio.table.touches >= strokes // 2:
            done = True
            act()

    studio.table.note = note


def _paint_along(studio: VirtualStudio, seed: int) -> None:
    """Paints strokes of a person, anywhere, in the paints of the wells."""
    random, size = _random(seed, 3), studio.easel.canvas
    side = np.array([size.width, size.height])
    length = _PERSON_LENGTH * side.min()
    for number in range(1, _PERSON_STROKES + 1):
        middle, angle = side * random.uniform(0.2, 0.8, 2), random.uniform(0, 2 * math.pi)
        along = np.linspace(-0.5, 0.5, 25)[:, None] * length
        place = middle + along * np.array([math.cos(angle), math.sin(angle)])
        still = np.zeros(len(place))
        studio.person.paint(
            PersonStroke(
                number, "medium", int(random.integers(len(studio.table.paints))), place, still + 0.5, still, still, 3.0
            )
        )


def _random(seed: int, which: int) -> np.random.Generator:
    return np.random.default_rng((seed, which))


def experiment(
    targets: Sequence[Target], *, seeds: Sequence[int] = (0, 1, 2), scale: RunSpec = FULL
) -> Experiment[PaintingTrial]:
    """Returns the experiment: every picture painted with and without looks, for each disturbance and seed."""
    pictures = {target.name: target.picture for target in targets}
    plans: dict[tuple[str, int], tuple[Plan, Tensor]] = {}
    names = [one.name for one in disturbances(seeds[0], scale.strokes)]
    looks: dict[str, dict[str, Any]] = {BLIND: {"replans": 0}, LOOKING: {}}

    def share_plan(target: str, seed: int) -> MakePlan:
        """Returns the maker of the plan of that picture and seed, which is made once in a process."""

        def make_plan(run: PaintingRun, tell: Tell) -> tuple[Plan, Tensor]:
            if (target, seed) not in plans:
                plans[target, seed] = paintings.make_first_plan(run, tell)
            return plans[target, seed]

        return make_plan

    def measure(trial: PaintingTrial, painted: Painted) -> Measurement:
        wanted = images.fit(pictures[trial["target"]], *painted.planned.shape[1:])
        return Measurement({SIMILARITY: psnr(painted.truth, wanted)}, {"painting": painted.truth})

    def report(results: Results) -> Outcome:
        return Outcome(
            NAME,
            "What looks win if something goes wrong",
            {"targets": tuple(pictures), "seeds": tuple(seeds), **paintings.settings(scale)},
            (
                ResultTable(
                    "Similarity to the photograph, PSNR in dB, mean", tuple(_row(results, one) for one in names)
                ),
                ResultTable("All paintings", results.rows()),
            ),
            _notes(results, names[1:]),
            {f"{NAME}-{target}": _sheet(results, names, target=target, seed=seeds[0]) for target in pictures},
        )

    trials = [
        PaintingTrial.of(
            {"target": target.name, "seed": seed, "disturbance": one.name, "painted": way},
            paintings.like(scale, target.picture, [{"image": str(target.path)}], seed, **changes),
            share_plan(target.name, seed),
            disturbance=one,
        )
        for way, changes in looks.items()
        for target in targets
        for seed in seeds
        for one in disturbances(seed, scale.strokes)
    ]
    return replace(paintings.experiment(trials, measure, report), sharing="disturbance")


def _row(results: Results, name: str) -> Row:
    found = {way: results.mean(SIMILARITY, disturbance=name, painted=way) for way in WAYS}
    gains = _gains(results, name)
    return {
        "disturbance": name,
        **found,
        "looks win": float(gains.mean()),
        "of them, at least": float(gains.min()),
        "it costs without looking": _cost(results, BLIND, name),
        "it costs with looks": _cost(results, LOOKING, name),
    }


def _gains(results: Results, name: str) -> NDArray[np.float64]:
    """Returns the gain of looks in dB for each picture and seed."""
    looking, blind = (np.array(results.values(SIMILARITY, disturbance=name, painted=way)) for way in (LOOKING, BLIND))
    return np.asarray(looking - blind, np.float64)


def _cost(results: Results, way: str, name: str) -> float:
    """Returns the mean loss in dB by a disturbance."""
    usual, disturbed = (results.mean(SIMILARITY, disturbance=one, painted=way) for one in (UNDISTURBED.name, name))
    return usual - disturbed


def _notes(results: Results, names: Sequence[str]) -> tuple[str, ...]:
    gains = np.concatenate([_gains(results, name) for name in names])
    usual = _gains(results, UNDISTURBED.name)
    blind, looking = (float(np.mean([_cost(results, way, name) for name in names])) for way in WAYS)
    return (
        f"Looks win {gains.mean():+.2f} dB in the mean of the disturbances ({(gains > 0).sum()} of {len(gains)} "
        f"paintings are better), and {usual.mean():+.2f} dB where nothing goes wrong.",
        f"A disturbance costs {blind:.2f} dB without looking and {looking:.2f} dB with looks.",
    )


def _sheet(results: Results, names: Sequence[str], **of: str | int) -> Tensor:
    """Returns a sheet with a line without looking and one with looks, and a painting for each disturbance."""
    lines = []
    for way in (BLIND, LOOKING):
        found = {name: results.one(**of, disturbance=name, painted=way) for name in names}
        cells = [
            Cell(one.pictures["painting"], f"{name}: {one.numbers[SIMILARITY]:.2f} dB") for name, one in found.items()
        ]
        lines.append(FigureRow(way, cells))
    return page("", (), lines, width=300)
