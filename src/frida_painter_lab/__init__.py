"""The laboratory: the paper's figures and tables, sweeps, and the benchmark of painters.

An experiment is a row: a question, its runs, a measure of a run, and tables and pictures of all (`experiment.py`). Its
command is `frida-painter experiments NAME` (`commands.py`). A run of a painting is a RunSpec, which PaintingRun plans
and paints (`paintings.py`).
"""

from frida_painter_cli.commands import Deferred

SWEEP = Deferred(
    "sweep",
    "frida_painter_lab.sweeps.sweep_command",
    "Do many runs: every combination of photographs, text, seeds and settings in a sweep file.",
)
EXPERIMENTS = Deferred(
    "experiments",
    "frida_painter_lab.commands",
    "Run the experiments of the paper and more. Each command measures anew and writes tables and pictures.",
)
BENCHMARK = Deferred(
    "benchmark",
    "frida_painter_lab.benchmark.benchmark_command",
    "Compare painters on a frozen suite, and judge strokes that other systems hand in.",
)
