"""The paper's figures and tables, and ours, each one command: `frida-painter experiments NAME`.

An experiment is a list of trials, a judge and a report (`trials.py`). A trial that is a painting is a RunSpec, and
PaintingRun plans and paints it (`paintings.py`). Every module has a `FULL` scale and a `QUICK` one: the same work, of
which the quick one does just enough to see that all of it runs.
"""

from dataclasses import dataclass

from frida_painter.cli.commands import Deferred

# How much an experiment about strokes does; one about paintings has a RunSpec in its place.


@dataclass(frozen=True, kw_only=True)
class ExperimentScale:
    """strokes: that are painted, in a sweep or for a library; held_out: strokes that no model learns from.

    sizes: numbers of strokes for training and validation, where there are several; folds: trainings of each;
    quick: as little as possible, so that figures mean nothing.
    """

    strokes: int
    held_out: int = 0
    sizes: tuple[int, ...] = ()
    folds: int = 1
    quick: bool = False


SWEEP = Deferred(
    "sweep",
    "frida_painter.lab.sweeps.command",
    "Do many runs: every combination of photographs, text, seeds and settings in a sweep file.",
)
EXPERIMENTS = Deferred(
    "experiments",
    "frida_painter.lab.commands",
    "Run the experiments of the paper and more. Each command measures anew and writes tables and pictures.",
)
