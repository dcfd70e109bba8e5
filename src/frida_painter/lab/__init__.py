"""The laboratory: the paper's figures and tables, and our own. Each has a command: `frida-painter experiments NAME`.

An experiment is a list of trials with a measurement and a report (`base.py`). A trial of a painting is a RunSpec,
which PaintingRun plans and paints (`paintings.py`). Every module has a `FULL` scale and a `QUICK` one. The quick
scale does the least work that runs every step.
"""

from dataclasses import dataclass

from frida_painter.cli.commands import Deferred

# Scales of experiments about strokes; experiments about paintings use a RunSpec instead.


@dataclass(frozen=True, kw_only=True)
class ExperimentScale:
    """Scale of an experiment about strokes.

    strokes: number of painted strokes, in a sweep or in a library
    held_out: number of strokes that no model learns from
    sizes: numbers of strokes for training and validation, if there are several
    folds: number of trainings for each size
    quick: True for the least possible work; the figures then mean nothing
    """

    strokes: int
    held_out: int = 0
    sizes: tuple[int, ...] = ()
    folds: int = 1
    quick: bool = False


SWEEP = Deferred(
    "sweep",
    "frida_painter.lab.sweeps.sweep_command",
    "Do many runs: every combination of photographs, text, seeds and settings in a sweep file.",
)
EXPERIMENTS = Deferred(
    "experiments",
    "frida_painter.lab.commands",
    "Run the experiments of the paper and more. Each command measures anew and writes tables and pictures.",
)
BENCHMARK = Deferred(
    "benchmark",
    "frida_painter.lab.benchmark.benchmark_command",
    "Compare painters on a frozen suite, and judge strokes that other systems hand in.",
)
