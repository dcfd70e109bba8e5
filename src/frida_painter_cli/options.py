"""Options of `paint` and `plan`: made from RunSpec and the kinds of goals, and read back into a RunSpec."""

import inspect
import sys
from collections.abc import Callable, Collection, Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from inspect import Parameter
from io import TextIOWrapper
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, get_args

import typer
from pydantic.fields import FieldInfo
from rich.console import Console
from rich.markup import escape
from rich.padding import Padding
from rich.table import Table

from frida_painter.errors import ConfigError, FridaError, Interrupted, PlanError
from frida_painter.objectives.objective import Gives, GoalKind, goal_kinds
from frida_painter.planning.fields import SEVERAL
from frida_painter.planning.settings import SettingSection, about, help_of, usual_of
from frida_painter.registry import Later
from frida_painter.runs.options import any_number, camera_name, out_file, out_folder, taking, whole_number
from frida_painter.runs.spec import OF_PLANS, GoalSettings, RunSpec
from frida_painter.system.operating_system import is_typed
from frida_painter_cli.imagining import ImaginingSettings

if TYPE_CHECKING:
    from frida_painter.strokes.palette import Palette


# Options of goals: one for each kind of goal.

_PANEL = GoalSettings.panel
_IMAGE = "image"  # kind of the goal PHOTO


def goal_options() -> list[Parameter]:
    """Returns the goal options as keyword parameters for Typer, in the order of the help.

    Each kind NAME has values and weights, NAME and NAME_weight. Then follow goals of the start, init_NAME, then
    goal (a file). `read_goal_options` reads them.
    """

    def several(name: str, kind: GoalKind, text: str) -> Parameter:
        typed: Any = str if kind.gives is Gives.WORDS else Path
        option = typer.Option(metavar=kind.gives.value, help=f"{text} May be repeated.", rich_help_panel=_PANEL)
        return _keyword(name, Annotated[list[typed] | None, option])

    kinds, options = list(goal_kinds().by_name.values()), []
    for kind in kinds:
        text = f"The weight of each {kind.option}, in the same order. [dim]1[/]"
        weight = typer.Option(parser=any_number, metavar="X", help=text, rich_help_panel=_PANEL)
        options += [several(kind.name, kind, kind.help)]
        options += [_keyword(f"{kind.name}_weight", Annotated[list[float] | None, weight])]
    options += [several(f"init_{kind.name}", kind, kind.initial_help) for kind in kinds if kind.initial_help]
    text = "A TOML file with goals and their weights."
    file = typer.Option("--goal", metavar="FILE", help=text, rich_help_panel=_PANEL)
    return [*options, _keyword("goal", Annotated[Path | None, file])]


def read_goal_options(photo: Path | None, given: Mapping[str, Any]) -> dict[str, list[Any]]:
    """Returns the goals from PHOTO, the options and the goal file, in the form of RunSpec.

    PHOTO counts as the first --image. Raises ConfigError if weights do not fit, or if the goal file cannot be read.
    """
    from frida_painter.runs.goal_item import read_goal_file

    read: dict[str, list[Any]] = {"goal": [], "initial": []}
    for kind in goal_kinds().by_name.values():
        first = [] if photo is None or kind.name != _IMAGE else [photo]
        values = [*first, *(given.get(kind.name) or [])]
        weights = given.get(f"{kind.name}_weight") or [1.0] * len(values)
        if len(weights) != len(values):
            raise ConfigError(
                f"{kind.option}-weight was given {len(weights)} times for {len(values)} goals"
                f"{', PHOTO among them' if first else ''}; give one weight for each, or none at all."
            )
        pairs = zip(values, weights, strict=True)
        read["goal"] += [{kind.name: str(value), "weight": float(weight)} for value, weight in pairs]
        read["initial"] += [{kind.name: str(value)} for value in given.get(f"init_{kind.name}") or []]
    filed = {} if given.get("goal") is None else read_goal_file(given["goal"])
    return {name: items + filed.get(name, []) for name, items in read.items()}


def tell_left_out(taken: Collection[str]) -> None:
    """Prints to stderr which kinds of goals of other packages cannot be used or have no option, and why."""
    doubles = [option.name for option in goal_options() if option.name in taken]
    sentence = "--{} is another option already; give that kind of goal in a file, with --goal."
    for complaint in (*goal_kinds().complaints, *map(sentence.format, doubles)):
        print(complaint, file=sys.stderr)


# Files of other commands: a plan to read, a picture to write.


def picture_file(text: str | Path) -> Path:
    """Reads the path of a picture to write. Raises StorageError, or typer.BadParameter for another ending."""
    path = out_file(text)
    if path.suffix.lower() not in (".png", ".jpg", ".jpeg"):
        raise typer.BadParameter(f"{str(path)[-60:]!r} was given; the picture ends in .png or .jpg")
    return path


PlanFile = Annotated[
    Path, typer.Argument(metavar="PLAN", help="A plan.json, or the folder of a painting.", show_default=False)
]
PictureOut = Annotated[Path, taking("FILE", "The picture to write, .png or .jpg.", parser=picture_file)]


# Wells before painting: a person sees the paints to mix, confirms them, and may enter the mixed ones.

AskOption = Annotated[
    bool,
    typer.Option(
        "--ask", help="Wait until you have filled the wells. You can then enter the paints that you really mixed."
    ),
]

FilledOption = Annotated[
    bool, typer.Option("--yes", "-y", help="Do not ask whether wells are filled, and let a machine home. For scripts.")
]


@dataclass
class Wells:
    """Dialogue about the wells of the next layers; the answer is the mixed paints, or None for the wanted ones.

    given: paints known from the beginning.
    ask: shows a prompt and returns the typed line. None: nobody is asked.
    folder: folder of the palette and the mixing sheet.
    poured: True if a person has confirmed before that the wells are filled.
    """

    given: "Palette | None"
    ask: Callable[[str], str] | None
    folder: Path
    poured: bool = False

    def fill(self, wanted: "Palette") -> "Palette | None":
        """Waits until the wells are filled, and returns the mixed paints. Raises Interrupted if the person leaves."""
        from frida_painter.perception.color import read_palette

        if self.ask is None:
            return self.given
        prompt = "Type go if they are just these paints, or the file that tells what you mixed: "
        if not self.poured:
            sheet = self._sheet(wanted)
            prompt = (
                f"Fill {len(wanted)} wells as on {self.folder / sheet} (mixing.png tells how to mix them). Type go "
                "when they are filled, or the file that tells what you mixed: "
            )
        while True:
            try:
                line = self.ask(prompt).strip()
            except (EOFError, KeyboardInterrupt) as end:
                raise Interrupted("Nobody said that the wells are filled, and nothing was painted.") from end
            if line.lower() == "go":
                return self.given
            if not line:  # Enter starts no motion
                continue
            try:
                return read_palette(Path(line), len(wanted))
            except FridaError as error:
                prompt = f"{error} Type go, or another file: "

    def _sheet(self, wanted: "Palette") -> str:
        """Returns the name of the sheet with these paints; that of the first layer if the plan does not tell."""
        import torch

        from frida_painter.report.sheets import sheet_file
        from frida_painter.strokes.plan import Plan

        layers: list[int] = []
        with suppress(PlanError):
            fillings = Plan.load(self.folder).by_wells()
            layers = [layer for layer, part in fillings if torch.equal(part.palette.color, wanted.color)]
        return sheet_file("palette.png", [*layers, 1][0])


TAKEN = frozenset(RunSpec.model_fields) - {"goal"} | {
    *("photo", "settings", "out", "ask", "yes", "candidates", "brush", "help_all", "plan", "page"),
    "variants",
    *ImaginingSettings.model_fields,
}
"""Names of options that no kind of goal can have."""
_FILES = "Where the painting goes"
_NAMES = {"brushes": ("--brushes", "--brush")}  # most people name one
_WITHOUT_OPTION = ("title", "goal", "initial")

Photo = Annotated[
    Path | None,
    typer.Argument(
        metavar="[PHOTO]", help="The picture to paint: a JPEG, PNG, WebP, TIFF, BMP or GIF file.", show_default=False
    ),
]
SettingsFile = Annotated[
    Path | None,
    taking("FILE", "A TOML file with these settings, for example: strokes = 300", "--settings", rich_help_panel=_FILES),
]
PageOption = Annotated[
    Path | None,
    taking(
        "FOLDER",
        "The studio's folder of this painting. People at its page answer the questions, and stop it there.",
        "--page",
    ),
]
Out = Annotated[
    Path | None,
    taking("FOLDER", "The output folder. [dim]paintings/NAME-DATE-TIME[/]", parser=out_folder, rich_help_panel=_FILES),
]


def planning_options(sections: Iterable[type[SettingSection]] = OF_PLANS) -> list[Parameter]:
    """Returns the options of a plan, with those of the settings in these sections."""
    every: tuple[type[SettingSection], ...] = (ImaginingSettings, *sections)
    return [
        *(option for option in goal_options() if option.name not in TAKEN),
        *(
            _keyword(
                name, _option(field, section.panel, camera_name if name == "camera" else None, *_NAMES.get(name, ()))
            )
            for section in every
            for name, field in section.model_fields.items()
            if name not in _WITHOUT_OPTION
        ),
        _keyword("settings", SettingsFile),
        _keyword("out", Out),
        _keyword("help_all", HelpAll, False),
    ]


def spec_of(photo: Path | None, given: Mapping[str, Any]) -> RunSpec:
    """Returns the description from PHOTO and the options, which override the TOML file of --settings.

    Raises ConfigError.
    """
    said = {name: value for name in RunSpec.model_fields if (value := given.get(name)) is not None and name != "goal"}
    asked = read_goal_options(photo, given)
    if asked["goal"] or given["settings"] is None:
        said |= asked
    return RunSpec.from_toml(given["settings"], **said) if given["settings"] else RunSpec.of(**said)


def require_person(spec: RunSpec, *, asked: bool) -> None:
    """Raises ConfigError if a person is to paint but not to be `asked` anything."""
    if spec.by_hand and not asked:
        raise ConfigError("--yes is for scripts, and a person who paints is asked for every stroke; leave it out.")


def _keyword(name: str, annotation: Any, default: Any = None) -> Parameter:
    return Parameter(name, Parameter.KEYWORD_ONLY, default=default, annotation=annotation)


def _option(field: FieldInfo, heading: str, parser: Callable[[str], str] | None, *names: str) -> Any:
    """Returns the command-line option of a setting, under a heading; `parser` reads its text."""
    more, kind = about(field), field.annotation
    told: dict[str, Any] = {"rich_help_panel": heading, "help": f"{help_of(field)} [dim]{usual_of(field)}[/]"}
    if kind in (bool, bool | None):
        return Annotated[bool | None, typer.Option(**told)]
    if kind in (int, int | None):
        return Annotated[int | None, typer.Option(parser=whole_number, metavar=more["value"] or "N", **told)]
    if kind in (float, float | None):
        return Annotated[float | None, typer.Option(parser=any_number, metavar=more["value"] or "X", **told)]
    value = more["value"] or "|".join(map(str, get_args(kind)))
    typed: Any = list[str] if SEVERAL in field.metadata else str
    return Annotated[typed | None, typer.Option(*names, metavar=value, parser=parser, **told)]


# Help of a command with many options: one screen of those that people use, and all of them with --help-all.

_OTHERS = ("text", "style", "sketch", "semantic", "variants", "out")
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
    bool, typer.Option("--help-all", is_eager=True, callback=_show_all, help="Show every option, with its whole help.")
]


# Painting together by words at the terminal: the option, and questions to a person.

ProposeOption = Annotated[
    str | None,
    taking(
        "NAME:TEXT",
        "Picture maker for changes by words: while it paints, type what shall change and press Enter, then choose "
        "one of its pictures, which begin from the canvas; diffusers:FOLDER, or command:PROGRAM with {canvas}. "
        "[dim]nothing is proposed[/]",
        "--propose",
        rich_help_panel="What to paint",
    ),
]
_require_canvas_maker = Later("frida_painter_words.picture_makers.making:require_canvas_maker")
_GLANCE = 0.2  # seconds between two looks whether the person has stopped


def require_proposer(maker: str | None, *, together: bool) -> None:
    """Raises ConfigError if a maker is wanted that is not there or takes no canvas, or without a goal to change."""
    if maker is not None and together:
        raise ConfigError("--propose changes a goal, and --together has none; leave out one.")
    if maker is not None:
        _require_canvas_maker(maker)


def ask_at_terminal(prompt: str, stop_asked: Callable[[], bool]) -> str:
    """Returns the line that is typed after a prompt; "" after Ctrl-D, which says no more than Enter.

    Raises EOFError if nobody can type, Interrupted after a stop.
    """
    print(prompt, end="", flush=True)
    while sys.stdin.isatty() and not is_typed(sys.stdin.fileno(), _GLANCE):
        if stop_asked():
            print()
            raise Interrupted("You stopped; what was painted is kept.")
    line = read_line()
    if not line and not sys.stdin.isatty():
        raise EOFError
    return line


def read_line() -> str:
    """Returns the next line that is typed; bytes that are no text become marks."""
    if not isinstance(sys.stdin, TextIOWrapper):
        return sys.stdin.readline()
    return sys.stdin.buffer.readline().decode(sys.stdin.encoding, "replace")
