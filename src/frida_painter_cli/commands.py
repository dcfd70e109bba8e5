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
from frida_painter.errors import FridaError, PaintingPaused, PluginError, RobotStopped
from frida_painter.system.storage import abridge
from frida_painter_cli.stop_signal import leave_terminal

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


def nothing_first() -> None:
    """Done before every command; that there is something keeps a single command's name."""


class _DeferredCommand(TyperCommand):
    """Entry in a list of commands that calls the real command."""

    def __init__(self, entry: Deferred) -> None:
        super().__init__(name=entry.name, help=entry.help, rich_markup_mode="rich")
        self._entry = entry

    def make_context(self, info_name: str | None, args: list[str], parent: Any = None, **extra: Any) -> Any:
        return self._entry.load().make_context(info_name, args, parent, **extra)


_CALIBRATION = "frida_painter_calibration.commands"
_LISTED = {
    "frida_painter_cli.painting": {
        "paint": "Paint a photograph or a text prompt. Plans, paints some strokes, looks at the canvas and replans the "
        "rest.",
        "plan": "Plan the strokes without painting. Writes the plan, a picture of it, the palette to mix and a "
        "shopping list.",
        "render": "Render a plan as a picture of any size.",
        "resume": "Continue a painting that was stopped, paused or killed, from its folder.",
        "watch": "Follow a painting that another terminal or the studio makes, until it ends or pauses for good.",
        "look": "Give a picture of the canvas to a painting without a camera. It counts as a look.",
    },
    "frida_painter_cli.plans": {
        "export": "Export the strokes of a plan as SVG, G-code or CSV, in millimetres.",
        "tiles": "Cut the plan of a picture that is larger than your machine into tiles, each an ordinary painting.",
        "check": "Check whether a robot can paint a whole plan on an easel, and how long it takes. Nothing moves.",
        "trace": "Trace the outline of the canvas and of a plan in the air, without paint.",
        "mix": "Give a recipe for each colour of a palette, from the paints that you own, with the predicted error.",
        "workspace": "Describe the workspace of a robot: where canvas, wells, water and rag stand, in metres.",
    },
    f"{_CALIBRATION}.setup": {
        "setup": "Set up a machine: find its port, guide its tip to the canvas, the wells and the lightest touch, and "
        "test it."
    },
    f"{_CALIBRATION}.calibrate": {
        "markers": "Write a sheet to print and cut: markers around the canvas, with which one photograph calibrates "
        "the camera.",
        "calibrate": "Calibrate an easel: the position of the canvas, the robot, the camera's colours, the brush and "
        "its strokes.",
        "doctor": "Show what the robot's controller tells, the state of the calibration, and the parts there are.",
        "parts": "Try every part that a package registers, as the program would use it, and say what is wrong with "
        "each.",
        "arm": "Allow a robot to move again after a stop. Look at the robot first.",
    },
    "frida_painter_studio.studio_command": {
        "studio": "Open the studio, a web page on which you set the goal, see the plan and paint together with the "
        "robot."
    },
    f"{_CALIBRATION}.teach": {
        "teach": "Teach a stroke: ten or more marks of one kind become a family of strokes for the planner."
    },
    "frida_painter_cli.commands": {"strokes": "Collect a library of strokes, and train and test stroke models on it."},
    "frida_painter_cli.models": {
        "models": "Download the networks for text, styles and sketches, and show which are here."
    },
}
COMMANDS = tuple(Deferred(name, module, text) for module, listed in _LISTED.items() for name, text in listed.items())
"""Commands of the project's core. Other packages add theirs through entry points."""
STROKE_COMMANDS = tuple(
    Deferred(name, f"{_CALIBRATION}.strokes", text)
    for name, text in {
        "paint": "Paint single strokes of all shapes in the virtual studio, photograph each, and save them as a "
        "library.",
        "inspect": "Find the flawed strokes of a library, give the reasons, and write a contact sheet of all strokes.",
        "train": "Train a stroke model on a library. It predicts a stroke's mark from its thickness, length and bend.",
        "evaluate": "Measure the error of a stroke model on strokes that were really painted.",
    }.items()
)


class _StrokeCommands(TyperGroup):
    def __init__(self, **settings: Any) -> None:
        super().__init__(**settings)
        self.commands = {entry.name: _DeferredCommand(entry) for entry in STROKE_COMMANDS}


def register(app: typer.Typer) -> None:
    """Adds the group of commands for stroke models."""
    group = typer.Typer(no_args_is_help=True, help=_LISTED[__name__]["strokes"], cls=_StrokeCommands)
    app.add_typer(group, name="strokes")


def _find_command(name: str) -> Deferred | None:
    """Returns a command of the core or of an entry point; None if it cannot be loaded (`doctor` shows the reason)."""
    added = registry.parts(registry.COMMANDS)
    with suppress(PluginError):
        own = next((entry for entry in COMMANDS if entry.name == name), None)
        return own or (added[name].load(Deferred) if name in added else None)
    return None


def all_commands() -> tuple[Deferred, ...]:
    """Returns all commands in list order, without those of other packages that cannot be loaded."""
    names = dict.fromkeys((*(entry.name for entry in COMMANDS), *registry.parts(registry.COMMANDS)))
    return tuple(filter(None, map(_find_command, names)))


class _AllCommands(TyperGroup):
    """Group of all commands: those of entry points are loaded if one is called, or if all are listed."""

    def list_commands(self, ctx: Any) -> list[str]:
        return [entry.name for entry in all_commands()]

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        entry = _find_command(cmd_name)
        return None if entry is None else _DeferredCommand(entry)


# Command line: builds the app, runs it and reports errors.

_PAUSED = 3
_MAX_SAID = 2000  # characters
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
        asked = isinstance(error, RobotStopped) and error.asked
        status = 128 + signal.SIGINT if asked else _PAUSED if isinstance(error, PaintingPaused) else 2
    except _UsageError as error:
        told = error.format_message().strip().rstrip(".")  # type: ignore[attr-defined]
        where = error.ctx.command_path if error.ctx else "frida-painter"  # type: ignore[attr-defined]
        _complain(f"{told}; `{where} --help` tells what can be given." if told else "")  # "": the help was just shown
        status = 2
    except BrokenPipeError:  # the reader of the output has closed it
        leave_terminal((1,))
        status = 128 + 13  # SIGPIPE
    except OSError as error:
        _complain(f"{abridge(str(error.filename or 'The system'))}: {error.strerror or error}; nothing more was done.")
        status = 2
    except Exception as failure:
        if (blamed := registry.blame(failure)) is None:
            raise
        _complain(str(blamed))
        status = 2
    sys.exit(status)


def _complain(message: str) -> None:
    """Prints a message without control characters, which file names may hold, and without rich's markup."""
    if len(message) > _MAX_SAID:  # a file said something long
        message = f"{message[: _MAX_SAID - 300]} ... {message[-300:]}"
    plain = "".join(sign if sign.isprintable() or sign == "\n" else "\N{REPLACEMENT CHARACTER}" for sign in message)
    plain = plain.replace("[", r"\[")
    if message:
        console = Console(stderr=True, highlight=False, soft_wrap=True)
        console.print(f"[bold red]frida-painter:[/] {plain}")
