"""The commands of the benchmark: benchmark list, cell, judge, table, page, pictures."""

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any

import typer

from frida_painter.errors import ConfigError, TryFailed
from frida_painter.runs.options import out_folder, whole_number_within
from frida_painter_lab.commands import Jobs, conduct

_DEFAULT_OUT = Path("benchmark")
_seed = whole_number_within(0, 2**31 - 1)
_budget = whole_number_within(1, 10_000)


def _names(text: str) -> list[str]:
    """Parses "a,b". Raises typer.BadParameter."""
    found = [part.strip() for part in text.split(",")]
    if not all(found) or len(set(found)) < len(found):
        raise typer.BadParameter(f"{text[:40]!r} names nothing at one place, or something twice")
    return found


def _numbers(text: str) -> list[int]:
    """Parses "11,12". Raises typer.BadParameter."""
    return [_seed(part) for part in _names(text)]


def _handed(text: str) -> tuple[str, Path]:
    """Parses "NAME=FOLDER". Raises typer.BadParameter."""
    name, equals, folder = text.partition("=")
    if not (name.strip() and equals and folder.strip()):
        raise typer.BadParameter(f"{text[:40]!r} is no NAME=FOLDER; write it like primitive=strokes/primitive")
    return name.strip(), Path(folder.strip())


Out = Annotated[
    Path, typer.Option(parser=out_folder, metavar="FOLDER", help="The folder of the table. The same one continues it.")
]
Goal = Annotated[
    str, typer.Option("--picture", metavar="NAME", help="A picture or goal of the suite, cat~7, or a picture file.")
]
Strokes = Annotated[
    int, typer.Option("--strokes", parser=_budget, metavar="N", help="The budget: 100, 300 or 1000 strokes.")
]
Seed = Annotated[int, typer.Option(parser=_seed, metavar="N", help="The seed of the virtual studio.")]
Pictures = Annotated[
    Any, typer.Option("--pictures", parser=_names, metavar="NAME,...", help="What is painted. [dim]all 24 pictures[/]")
]


def register(app: typer.Typer) -> None:
    """Adds the group of commands."""
    group = typer.Typer(
        no_args_is_help=True, help="Compare painters on a frozen suite, and judge strokes that other systems hand in."
    )
    group.command("list")(list_suite)
    for command in (pictures, judge, cell, table, page):
        group.command(command.__name__)(command)
    app.add_typer(group, name="benchmark")


def list_suite() -> None:
    """List the pictures, goals, budgets, seeds and entrants of the suite."""
    from frida_painter_lab.benchmark.suite import BUDGETS, GOALS, PICTURES, SEEDS, VERSION, suite_digest
    from frida_painter_lab.benchmark.table import ENTRANTS

    print(f"Suite     {VERSION}, {suite_digest()[:12]}")
    print(f"Pictures  {', '.join(PICTURES)}")
    print(f"Goals     {', '.join(GOALS)}")
    print(f"Seeds     {', '.join(map(str, SEEDS))}")
    for one in BUDGETS.values():
        print(f"Budget    {one.strokes} strokes, {one.paints} paints, {one.minutes:g} minutes, {one.dips} dips")
    for entrant in ENTRANTS.values():
        print(f"Entrant   {entrant.name}: {entrant.words}")


def pictures(
    out: Annotated[Path, typer.Argument(metavar="FOLDER", parser=out_folder, help="Where they are written.")],
    names: Pictures = None,
    held_out: Annotated[
        int | None, typer.Option(parser=_seed, metavar="SEED", help="Write the held-out pictures of this seed.")
    ] = None,
) -> None:
    """Write the pictures of the suite, and the canvas of each, for a system that is to be entered."""
    from frida_painter.system import images
    from frida_painter_lab.benchmark.suite import PICTURES, find_goal
    from frida_painter_lab.benchmark.table import INPUTS

    chosen = names or list(PICTURES)
    for name in [f"{one}~{held_out}" for one in chosen] if held_out is not None else chosen:
        goal = find_goal(name, out / INPUTS)
        if goal.picture is not None:
            path = out / f"{name.replace('~', '-')}.png"
            images.save(goal.picture, path)
            print(f"{path}  {goal.canvas}")


def judge(
    strokes: Annotated[
        Path, typer.Argument(metavar="FILE", help="The strokes: .svg, .csv or a plan.json.", show_default=False)
    ],
    picture: Goal,
    budget: Strokes = 100,
    name: Annotated[str, typer.Option(help="The name of the entrant.")] = "handed in",
    seed: Seed = 11,
    out: Out = _DEFAULT_OUT,
) -> None:
    """Paint strokes of another system in the virtual studio, and judge the painting."""
    _paint_one(picture, budget, seed, out, hand_ins={name: str(strokes.absolute())})


def cell(
    entrant: Annotated[str, typer.Option(metavar="NAME", help="An entrant of the project: see benchmark list.")],
    picture: Goal,
    strokes: Strokes = 100,
    seed: Seed = 11,
    out: Out = _DEFAULT_OUT,
) -> None:
    """Paint and judge one cell of the table; takes minutes. A cell that is done is only shown."""
    _paint_one(picture, strokes, seed, out, entrants=(entrant,))


def _paint_one(
    picture: str,
    strokes: int,
    seed: int,
    out: Path,
    entrants: tuple[str, ...] = (),
    hand_ins: Mapping[str, str] | None = None,
) -> None:
    """Paints and judges one cell, and prints its figures."""
    from frida_painter.system.devices import prepare_process
    from frida_painter_lab.benchmark.table import BenchmarkTable
    from frida_painter_lab.experiment import silent

    prepare_process()
    asked = BenchmarkTable(
        folder=out.absolute(), entrants=entrants, goals=(picture,), budgets=(strokes,), seeds=(seed,),
        hand_ins=hand_ins or {},
    )  # fmt: skip
    (run,) = asked.all_runs
    found = asked.measure_or_load(run, asked.folder, silent)
    for name, value in found.numbers.items():
        print(f"  {name:20} {value:.4g}")
    for remark in found.remarks:
        print(f"  {remark}")
    print(f"  Painting  {out / 'runs' / run.key / 'painting.png'}")


def table(
    pictures: Pictures = None,
    entrants: Annotated[
        Any, typer.Option(parser=_names, metavar="NAME,...", help="Entrants. [dim]all of the project[/]")
    ] = None,
    strokes: Annotated[
        Any, typer.Option(parser=_numbers, metavar="N,...", help="Budgets in strokes.")
    ] = "100,300,1000",
    seeds: Annotated[
        Any, typer.Option(parser=_numbers, metavar="N,...", help="Seeds of the studio. [dim]11,12,13,14,15[/]")
    ] = None,
    hand_in: Annotated[
        list[Any] | None,
        typer.Option(
            parser=_handed, metavar="NAME=FOLDER",
            help="An entrant that hands in strokes, as cat-100.svg in a folder. May be repeated.",
        ),
    ] = None,
    out: Out = _DEFAULT_OUT,
    jobs: Jobs = None,
) -> None:  # fmt: skip
    """Paint and judge all cells that are not done, in several processes; write table and page.

    After an interruption, or with more pictures, entrants or seeds, run the same command again.
    """
    from frida_painter_lab.benchmark.suite import PICTURES, SEEDS
    from frida_painter_lab.benchmark.table import ENTRANTS, BenchmarkTable, write_page

    folders = {name: folder.absolute() for name, folder in hand_in or ()}
    for folder in folders.values():
        if not folder.is_dir():
            raise ConfigError(f"{folder} is no folder of hand-ins; it holds files such as cat-100.svg.")
    asked = BenchmarkTable(
        folder=out.absolute(), entrants=tuple(entrants or ENTRANTS), goals=tuple(pictures or PICTURES),
        budgets=tuple(strokes), seeds=tuple(seeds or SEEDS),
        hand_ins={name: str(folder) for name, folder in folders.items()},
    )  # fmt: skip
    assert asked.all_runs  # whatever is wrong is told before anything is written
    asked.write_request()
    try:
        outcome = conduct(asked, asked.folder, jobs, stays=True)
    except TryFailed:
        page(out)
        raise
    print("\n".join(one.markdown() for one in outcome.tables))
    print(f"  Page  {write_page(outcome, asked.folder)}")


def page(out: Annotated[Path, typer.Argument(metavar="FOLDER", help="The folder of a table.")] = _DEFAULT_OUT) -> None:
    """Write the page of a table again, with all cells that are done by now."""
    from frida_painter_lab.benchmark.table import read_table, write_page

    known = read_table(out)
    outcome = known.report(known.collect_results(known.folder))
    outcome.save(known.folder)
    print("\n".join(one.markdown() for one in outcome.tables))
    print(f"  Page  {write_page(outcome, known.folder)}")
