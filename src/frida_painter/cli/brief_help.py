"""Help of a command with many options: one screen of those that people use, and all of them with --help-all."""

import inspect
from collections.abc import Iterable
from typing import Annotated, Any

import typer
from rich.console import Console
from rich.markup import escape
from rich.padding import Padding
from rich.table import Table

from frida_painter.runs.settings import about
from frida_painter.runs.spec import RunSpec

_OTHERS = ("text", "style", "sketch", "semantic", "out")
"""Options of the short help beside those of common settings."""
_SHORT = 36  # letters of a default that the short help tells


class BriefCommand(typer.core.TyperCommand):
    """Command whose --help is short."""

    def format_help(self, ctx: Any, formatter: Any) -> None:
        """Prints the common options, each with the first sentence of its help."""
        console, options = _begin(self, ctx, whole=False)
        common = {*_OTHERS, *(name for name, field in RunSpec.model_fields.items() if about(field)["common"])}
        for heading, of_panel in _panels(option for name, option in options.items() if name in common):
            table = Table.grid(padding=(0, 2), pad_edge=True)
            for option in of_panel:
                said, _, default = option.help.partition("[dim]")
                first, dot, _ = said.strip().partition(". ")
                usual = f" [dim]({default.removesuffix('[/]')})[/]" if 0 < len(default) < _SHORT else ""
                table.add_row(_flags(option), first + "." * bool(dot) + usual)
            console.print(f"\n[bold]{heading}[/]", table, sep="\n")
        console.print(f"\n[bold]{ctx.command_path} --help-all[/] tells all of {len(options)} options.")


def _begin(command: Any, ctx: Any, *, whole: bool) -> tuple[Console, dict[str, Any]]:
    """Prints usage and description, and returns the console and the options by name."""
    console = Console(highlight=False)
    usage = escape(" ".join(command.collect_usage_pieces(ctx)).replace("[[", "[").replace("]]", "]"))
    console.print(f"Usage: {ctx.command_path} {usage}\n")
    said = inspect.cleandoc(command.help or "").split("\n\n")
    console.print("\n\n".join(" ".join(one.split()) for one in (said if whole else said[:1])))
    return console, {one.name: one for one in command.get_params(ctx) if one.param_type_name == "option"}


def _panels(options: Iterable[Any]) -> list[tuple[str, list[Any]]]:
    """Returns options by the headings of their panels, in the order of the first option of each."""
    panels: dict[str, list[Any]] = {}
    for option in options:
        heading = getattr(option, "rich_help_panel", None) or "The command itself"
        panels.setdefault(heading, []).append(option)
    return list(panels.items())


def _flags(option: Any) -> str:
    """Returns how an option is written, with rich's markup."""
    value = "" if option.is_flag else f" {escape(option.metavar or option.type.name.upper())}"
    return f"[cyan]{', '.join((*option.opts, *option.secondary_opts))}[/]{value}"


def _show_all(ctx: typer.Context, asked: bool) -> None:
    """Prints every option with its whole help, and ends the program."""
    if not asked:
        return
    console, options = _begin(ctx.command, ctx, whole=True)
    for heading, of_panel in _panels(options.values()):
        console.print(f"\n[bold]{heading}[/]")
        for option in of_panel:
            said = (option.help or "").replace("[dim]", "[dim]Default: ")
            console.print(f"  {_flags(option)}", Padding(said, (0, 0, 0, 6)), sep="\n")
    raise typer.Exit


HelpAll = Annotated[
    bool,
    typer.Option("--help-all", is_eager=True, callback=_show_all, help="Show every option, with its whole help."),
]
