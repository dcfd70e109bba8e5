"""The command that lets a stopped robot move again: arm."""

import sys
from typing import Annotated

import typer

from frida_painter.errors import Interrupted, RobotStopped
from frida_painter.hardware.latch import latches
from frida_painter.session.names import state_folder


def register(app: typer.Typer) -> None:
    """Adds the command."""
    app.command("arm")(arm)


def arm(
    yes: Annotated[
        bool,
        typer.Option("--yes", help="Do not ask. For scripts of a person who stands beside the robot and has looked."),
    ] = False,
) -> None:
    """Allow a robot to move again after a stop. Look at the robot first.

    A stop lasts until you arm the robot, even after a restart. Reasons for a stop are a second Ctrl-C,
    the stop file, a painter process that does not respond, and a fault of the robot.
    """
    held = latches(state_folder())
    if not held:
        print("No robot is stopped.")
    for latch in held:
        stopped = latch.read()
        if stopped is None:
            continue  # somebody else was faster
        print(f"{stopped}.")
        if yes or _confirmed():
            latch.release()
            print(f"{stopped.easel} may move again.")
        else:
            print(f"{stopped.easel} stays stopped.")


def _confirmed() -> bool:
    """Whether the person at the terminal says so. Raises RobotStopped where nobody sits there."""
    if not sys.stdin.isatty():
        raise RobotStopped(
            "A robot is armed by somebody who looks at it: run `frida-painter arm` in a terminal beside it, or, from a "
            "script of your own, with --yes."
        )
    try:
        return input("Is nobody in its way, and is the brush free? Arm it? [y/N] ").strip().lower() in ("y", "yes")
    except (EOFError, KeyboardInterrupt) as end:
        raise Interrupted("Nothing was changed; the robot stays stopped.") from end
