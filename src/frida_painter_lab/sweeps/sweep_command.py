"""The commands for many runs: sweep FILE, sweep status, sweep report."""

import sys
import time
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Annotated, Any

import typer
from typer.core import TyperGroup

from frida_painter.errors import Interrupted, TryFailed
from frida_painter.runs.options import out_folder
from frida_painter.system.storage import count_of
from frida_painter_lab.commands import Jobs, show_progress

if TYPE_CHECKING:
    from frida_painter.runs.spec import RunSpec
    from frida_painter.strokes.plan import Plan

SweepFile = Annotated[
    Path, typer.Argument(metavar="FILE", help="A sweep file (TOML, docs/how-to/sweep.md).", show_default=False)
]
FolderOfSweep = Annotated[Path, typer.Argument(metavar="FOLDER", help="The folder of a sweep.", show_default=False)]
Out = Annotated[
    Path | None,
    typer.Option(
        parser=out_folder,
        metavar="FOLDER",
        help="The folder of the sweep. The same one continues it. [dim]sweeps/NAME[/]",
    ),
]
Yes = Annotated[bool, typer.Option("--yes", help="Do not ask before a very large sweep.")]
_RUN = "run"


class _FileFirst(TyperGroup):
    """Command group in which an argument that is no command is the FILE of `run`."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        first = next((arg for arg in args if not arg.startswith("-")), None)
        if first is not None and first not in self.commands:
            args = [_RUN, *args]
        return super().parse_args(ctx, args)


def register(app: typer.Typer) -> None:
    """Adds the group of commands."""
    group = typer.Typer(
        cls=_FileFirst,
        no_args_is_help=True,
        help="Do many runs: every combination of photographs, text, seeds and settings in a sweep file.",
    )
    group.command(_RUN)(run)
    group.command("status")(status)
    group.command("report")(report)
    app.add_typer(group, name="sweep")


def run(file: SweepFile, out: Out = None, jobs: Jobs = None, yes: Yes = False) -> None:
    """Do all runs of a sweep file that are not done yet: `sweep FILE` is short for `sweep run FILE`.

    Every run has a folder of its own. Run the same command again to continue after an interruption; what was done is
    not done again. A run that fails, hangs or is killed is tried again, then reported, and never stops the others.
    """
    from frida_painter.session.time_left import duration
    from frida_painter_cli.leading import confirm
    from frida_painter_lab.sweeps.runner import MANY, default_folder, sweep
    from frida_painter_lab.sweeps.sweep_spec import SweepSpec

    spec = SweepSpec.from_toml(file)
    if spec.count > MANY and not yes:
        question = f"The sweep has {spec.count:,} runs. Begin?"
        if not sys.stdin.isatty() or not confirm(question, default=False):
            raise Interrupted(f"The sweep has {spec.count:,} runs, and nothing was begun; say --yes if that is meant.")
    folder = out or default_folder(spec)
    started = time.monotonic()
    with show_progress() as hear:
        outcome = sweep(spec, folder, jobs=jobs, notify=hear, most=None)
    new = len(outcome.records) - outcome.done_before
    print(
        f"{count_of(len(outcome.records), 'run')} of {len(outcome.runs)} done"
        + (f", {outcome.done_before} of them before" if outcome.done_before else "")
        + f"; {new} in {duration(time.monotonic() - started)}."
    )
    for remark in outcome.remarks:
        print(remark, file=sys.stderr)
    print(f"  Results   {folder}\n  Page      frida-painter sweep report {folder}")
    if outcome.failures:
        first = next(iter(outcome.failures.values()))
        raise TryFailed(
            f"{count_of(len(outcome.failures), 'run')} failed after {spec.tries} tries each; the first is "
            f"{first['key']}: {first['error']} Run the command again to try them once more."
        )


def status(folder: FolderOfSweep) -> None:
    """Show how far a sweep is, how long it still takes and which runs failed."""
    from frida_painter_lab.sweeps.report import read_state

    print("\n".join(read_state(folder).lines()))


def report(folder: FolderOfSweep) -> None:
    """Write the page of a sweep: all pictures, curves with confidence intervals, and paired tests."""
    from frida_painter_lab.sweeps.report import keep_table, read_state, write_report

    found = read_state(folder)
    for remark in keep_table(found):
        print(remark, file=sys.stderr)
    print(f"{found.lines()[0]}\n  Page  {write_report(found)}")


def choose_candidate(spec: "RunSpec", candidates: int) -> "tuple[RunSpec, Plan]":
    """Returns the spec with the best of `candidates` seeds, and its plan; shows progress and prints the choice."""
    from frida_painter_lab.sweeps.runner import best_candidate

    with TemporaryDirectory() as folder, show_progress() as hear:
        chosen, plan, told = best_candidate(spec, candidates, Path(folder), hear)
    print(told, file=sys.stderr)
    return chosen, plan
