"""The command `setup`: sets a machine up together with the person who stands at it."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from frida_painter.runs.options import taking, with_fields
from frida_painter_calibration.options import SetupOrder

if TYPE_CHECKING:
    from frida_painter_calibration.machine_setup import SetupEvent


def setup(
    *,
    order: SetupOrder,
    show: Annotated[
        str | None, taking("NAME", "Print a preset's file, as the beginning of your own, and exit.")
    ] = None,
    presets: Annotated[bool, typer.Option("--presets", help="List the presets, and exit.")] = False,
) -> None:
    """Set up a machine: find its port, guide its tip to the canvas, the wells and the lightest touch, and test it.

    A preset says what is known of your kind of machine. You guide the tip with the arrow keys. The outlines
    are then traced in the air, and three strokes are painted. You can leave at any step; the same command
    continues. It writes a workspace, a calibration record, and a picture of the table.
    """
    from frida_painter.hardware.preset import read_preset
    from frida_painter.system.devices import prepare_process
    from frida_painter_calibration.machine_setup import lead_setup
    from frida_painter_cli.terminal import GuidingKeys, terminal_at

    if presets:
        _list_presets()
        return
    if show is not None:
        print(read_preset(show), end="")
        return
    prepare_process()
    terminal = terminal_at(order.folder or Path.cwd(), keys=GuidingKeys.of_this_terminal())
    lead_setup(order, terminal.answer, _tell)


def _list_presets() -> None:
    from rich.console import Console
    from rich.table import Table as Rows

    from frida_painter.hardware.preset import presets, user_folder

    rows = Rows("preset", "machine", "--robot", box=None, padding=(0, 2, 0, 0))
    for preset in presets().values():
        rows.add_row(preset.name, preset.title, preset.robot_name())
    console = Console(highlight=False, soft_wrap=True)
    console.print(rows)
    console.print(f"Your own presets are files NAME.toml in {user_folder()}", markup=False)


_MARKS = {"fact": "  ", "warning": "! ", "refusal": "x "}


def _tell(event: "SetupEvent") -> None:
    """Prints what happens in a setup."""
    from frida_painter.session.events import Began, Remark, ResultFound
    from frida_painter_calibration.procedures.workspace import STEPS

    match event:
        case Remark(sentence):
            print(sentence)
        case ResultFound("facts", detail=told):
            for fact in told["facts"]:
                print(f"{_MARKS[fact['weight']]}{fact['text']}")
        case Began(name=name):
            print(f"\nStep {list(STEPS).index(name) + 1} of {len(STEPS)}: {STEPS[name][0]}")
        case ResultFound("setup", detail=told):
            print(f"\nThe workspace: {told['workspace']}\nThe calibration record: {told['record']}")
            print(f"The table as a picture: {told['sheet']}")
            for each in told["commands"]:
                print(f"{each['about']}:\n  {each['command']}")
        case _:
            pass


def register(app: typer.Typer) -> None:
    """Adds the command."""
    app.command("setup")(with_fields(setup))
