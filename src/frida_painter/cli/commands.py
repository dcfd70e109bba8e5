"""All commands of the command line, by name; help and docs list them in this order."""

import signal
import sys
from contextlib import suppress
from dataclasses import dataclass
from importlib import import_module
from typing import Any

import typer
from rich.console import Console
from typer.core import TyperCommand, TyperGroup
from typer.main import get_group

from frida_painter import registry
from frida_painter.cli.stop_signal import leave_terminal
from frida_painter.errors import FridaError, PaintingPaused, PluginError, RobotStopped
from frida_painter.storage import abridge

# Deferred commands: listed by name and one sentence; the module is imported only when the command is called.


@dataclass(frozen=True)
class Deferred:
    """Command or group of commands that is imported when it is called.

    name: its name.
    module: module whose `register(app)` adds it.
    help: first paragraph of the command's own help, word for word; a test compares them.
    """

    name: str
    module: str
    help: str

    def load(self) -> Any:
        """Imports the module and returns the command with its options."""
        app = typer.Typer(callback=nothing_first, rich_markup_mode="rich")
        import_module(self.module).register(app)
        return get_group(app).commands[self.name]


def group_of(entries: tuple[Deferred, ...]) -> type[TyperGroup]:
    """Returns a group class whose commands are these entries, in that order: for `typer.Typer(cls=...)`."""

    class DeferredGroup(TyperGroup):
        def __init__(self, **settings: Any) -> None:
            super().__init__(**settings)
            self.commands = {entry.name: _DeferredCommand(entry) for entry in entries}

    return DeferredGroup


def nothing_first() -> None:
    """Done before every command; that there is something keeps a single command's name."""


class _DeferredCommand(TyperCommand):
    """Entry in a list of commands that calls the real command."""

    def __init__(self, entry: Deferred) -> None:
        super().__init__(name=entry.name, help=entry.help, rich_markup_mode="rich")
        self._entry = entry

    def make_context(self, info_name: str | None, args: list[str], parent: Any = None, **extra: Any) -> Any:
        return self._entry.load().make_context(info_name, args, parent, **extra)


_CLI = "frida_painter.cli"

COMMANDS = (
    Deferred(
        "paint",
        f"{_CLI}.painting",
        "Paint a photograph or a text prompt. Plans, paints some strokes, looks at the canvas and replans the rest.",
    ),
    Deferred(
        "plan",
        f"{_CLI}.painting",
        "Plan the strokes without painting. Writes the plan, a picture of the plan and the palette to mix.",
    ),
    Deferred(
        "render", f"{_CLI}.painting", "Render a plan as a picture of any size, with the stroke models of its brushes."
    ),
    Deferred("resume", f"{_CLI}.painting", "Continue a painting that was stopped, paused or killed, from its folder."),
    Deferred(
        "look", f"{_CLI}.painting", "Give a picture of the canvas to a painting without a camera. It counts as a look."
    ),
    Deferred("export", f"{_CLI}.plans", "Export the strokes of a plan as SVG, G-code or CSV, in millimetres."),
    Deferred(
        "setup",
        "frida_painter_calibration.commands.setup",
        "Set up a machine: find its port, guide its tip to the canvas, the wells and the lightest touch, and test it.",
    ),
    Deferred(
        "calibrate",
        "frida_painter_calibration.commands.calibrate",
        "Calibrate an easel: the position of the canvas, the robot, the camera's colours, the brush and its strokes.",
    ),
    Deferred(
        "doctor",
        "frida_painter_calibration.commands.calibrate",
        "Show what the robot's controller tells, the state of the calibration, and the parts there are.",
    ),
    Deferred(
        "parts",
        "frida_painter_calibration.commands.calibrate",
        "Try every part that a package registers, as the program would use it, and say what is wrong with each.",
    ),
    Deferred(
        "arm",
        "frida_painter_calibration.commands.calibrate",
        "Allow a robot to move again after a stop. Look at the robot first.",
    ),
    Deferred(
        "check",
        f"{_CLI}.plans",
        "Check whether a robot can paint a whole plan on an easel, and how long it takes. Nothing moves.",
    ),
    Deferred("trace", f"{_CLI}.plans", "Trace the outline of the canvas and of a plan in the air, without paint."),
    Deferred(
        "mix",
        f"{_CLI}.plans",
        "Give a recipe for each colour of a palette, from the paints that you own, with the predicted error.",
    ),
    Deferred(
        "studio",
        "frida_painter_studio.studio_command",
        "Open the studio, a web page on which you set the goal, see the plan and paint together with the robot.",
    ),
    Deferred(
        "workspace",
        f"{_CLI}.plans",
        "Describe the workspace of a robot: where canvas, wells, water and rag stand, in metres.",
    ),
    Deferred(
        "teach",
        "frida_painter_calibration.commands.teach",
        "Teach a stroke: ten or more marks of one kind become a family of strokes for the planner.",
    ),
    Deferred("strokes", f"{_CLI}.commands", "Collect a library of strokes, and train and test stroke models on it."),
    Deferred(
        "models", f"{_CLI}.models", "Download the networks for text, styles and sketches, and show which are here."
    ),
)
"""Commands of the project's core. Other packages add theirs through entry points."""


def all_commands() -> tuple[Deferred, ...]:
    """Returns all commands in list order, without those of other packages that cannot be loaded."""
    return (*COMMANDS, *filter(None, map(_added, _names_added())))


def _names_added() -> list[str]:
    """Returns the names of the commands that entry points add to those of the core; imports nothing."""
    known = {entry.name for entry in COMMANDS}
    return [name for name in registry.parts(registry.COMMANDS) if name not in known]


def _added(name: str) -> Deferred | None:
    """Returns a command of an entry point; None if it cannot be loaded (`doctor` shows the reason)."""
    with suppress(PluginError):
        return registry.parts(registry.COMMANDS)[name].load(Deferred)
    return None


class _AllCommands(TyperGroup):
    """Group of all commands: those of entry points are loaded if one is called, or if all are listed."""

    def list_commands(self, ctx: Any) -> list[str]:
        return [entry.name for entry in all_commands()]

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        own = {entry.name: entry for entry in COMMANDS}
        entry = own.get(cmd_name) or (_added(cmd_name) if cmd_name in _names_added() else None)
        return None if entry is None else _DeferredCommand(entry)


# Command line: builds the app, runs it and reports errors.

_PAUSED = 3
# The class of all usage errors is private in Typer; this is a base class of a public one.
_UsageError: type[Exception] = typer.BadParameter.__bases__[0]


def build() -> typer.Typer:
    """Returns the app `frida-painter` with all commands."""
    return typer.Typer(
        name="frida-painter",
        help="A robot painter. It plans brush strokes, paints some, looks at the canvas and replans the rest.",
        no_args_is_help=True,
        add_completion=False,
        pretty_exceptions_enable=False,
        rich_markup_mode="rich",
        context_settings={"help_option_names": ["-h", "--help"]},
        callback=nothing_first,
        cls=_AllCommands,
    )


_MAX_SAID = 2000  # characters


def main() -> None:
    """Runs the command line.

    The exit status is 0 for success, 2 for an error with one sentence, 3 for a paused painting that can be resumed,
    and 130 after a stop, also by the stop file. Raises KeyboardInterrupt after a signal (__main__.py).
    """
    try:
        status = build()(prog_name="frida-painter", standalone_mode=False)
    except typer.Abort as abort:  # Typer's name for a signal
        raise KeyboardInterrupt from abort
    except FridaError as error:
        _complain(str(error))
        status = _status(error)
    except _UsageError as error:
        _complain(_advice(error))
        status = 2
    except BrokenPipeError:  # the reader of the output has closed it
        leave_terminal((1,))
        status = 128 + signal.SIGPIPE
    except OSError as error:
        _complain(f"{abridge(str(error.filename or 'The system'))}: {error.strerror or error}; nothing more was done.")
        status = 2
    except Exception as failure:
        if (blamed := registry.blame(failure)) is None:
            raise
        _complain(str(blamed))
        status = 2
    sys.exit(status)


def _status(error: FridaError) -> int:
    if isinstance(error, RobotStopped) and error.asked:
        return 128 + signal.SIGINT
    return _PAUSED if isinstance(error, PaintingPaused) else 2


def _complain(message: str) -> None:
    if len(message) > _MAX_SAID:  # a file said something long
        message = f"{message[: _MAX_SAID - 300]} ... {message[-300:]}"
    if message:
        Console(stderr=True, highlight=False, soft_wrap=True).print(f"[bold red]frida-painter:[/] {_plain(message)}")


def _advice(error: Any) -> str:
    """Returns a message about a wrong command, with its help command; "" if the help was just shown."""
    message = error.format_message().strip().rstrip(".")
    if not message:
        return ""
    return f"{message}; `{error.ctx.command_path if error.ctx else 'frida-painter'} --help` tells what can be given."


def _plain(message: str) -> str:
    """Returns a message without control characters, which file names may hold, and without rich's markup."""
    printable = "".join(
        character if character.isprintable() or character == "\n" else "\N{REPLACEMENT CHARACTER}"
        for character in message
    )
    return printable.replace("[", r"\[")


# Commands for stroke models: strokes paint, inspect, train, evaluate.

STROKE_COMMANDS = (
    Deferred(
        "paint",
        "frida_painter_calibration.commands.strokes",
        "Paint single strokes of all shapes in the virtual studio, photograph each, and save them as a library.",
    ),
    Deferred(
        "inspect",
        "frida_painter_calibration.commands.strokes",
        "Find the flawed strokes of a library, give the reasons, and write a contact sheet of all strokes.",
    ),
    Deferred(
        "train",
        "frida_painter_calibration.commands.strokes",
        "Train a stroke model on a library. It predicts a stroke's mark from its thickness, length and bend.",
    ),
    Deferred(
        "evaluate",
        "frida_painter_calibration.commands.strokes",
        "Measure the error of a stroke model on strokes that were really painted.",
    ),
)


def register(app: typer.Typer) -> None:
    """Adds the group of commands."""
    group = typer.Typer(
        no_args_is_help=True,
        help="Collect a library of strokes, and train and test stroke models on it.",
        cls=group_of(STROKE_COMMANDS),
    )
    app.add_typer(group, name="strokes")
