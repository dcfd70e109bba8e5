"""Commands for an easel: calibrate, doctor, parts and arm."""

import sys
from contextlib import ExitStack, nullcontext
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from frida_painter.brush import FEWEST_STROKES, MAX_BETWEEN_REFILLS, MAX_STROKES
from frida_painter.canvas_size import CanvasSize
from frida_painter.easel.kinds import state_folder
from frida_painter.errors import ConfigError, RobotStopped, StorageError
from frida_painter.hardware.latch import latches
from frida_painter.registry import Later
from frida_painter.runs.options import out_file, setting_option, taking, whole_number_option, with_fields
from frida_painter_calibration.options import EaselOptions, SurfaceOptions

if TYPE_CHECKING:
    from frida_painter.calibration import Done
    from frida_painter.easel.dialogue import Answer, Question

_check_parts = Later("frida_painter_lab.conformance:check")


What = StrEnum("What", "start canvas robot color brush strokes surface all")
"""Names of the calibration procedures; `start` is canvas and robot, and `all` is all but the surface."""
RecordOption = Annotated[
    Path | None,
    taking("FILE", "The calibration record to write or read. [dim]one per easel in your data folder[/]", "--record"),
]


def calibrate(
    *,
    what: Annotated[
        What,
        typer.Argument(
            metavar="[start|canvas|robot|color|brush|strokes|surface|all]",
            help="The procedure to run; start is canvas and robot.",
        ),
    ] = What.start,
    easel: EaselOptions,
    placement_error: Annotated[str | None, setting_option("placement_error")] = None,
    count: Annotated[
        int,
        whole_number_option(
            FEWEST_STROKES, MAX_STROKES, "Number of strokes that the strokes procedure paints for training."
        ),
    ] = 200,
    refill_every: Annotated[
        int,
        whole_number_option(
            1,
            MAX_BETWEEN_REFILLS,
            "Strokes per dip in the strokes procedure. With 2 or more it learns how long a dip lasts.",
        ),
    ] = 1,
    ask: Annotated[
        bool,
        typer.Option("--ask", help="Ask you the questions of a real easel. Without it, the virtual studio answers."),
    ] = False,
    surface: SurfaceOptions,
    record: RecordOption = None,
) -> None:
    """Calibrate an easel: the position of the canvas, the robot, the camera's colours, the brush and its strokes.

    Each procedure saves its result in the easel's calibration record, most with a picture. start, the usual one,
    takes two photographs: of the bare canvas, with the printed markers if you have them, and of six painted dots. Then
    you can paint. all runs the five procedures in order. surface is for an uneven canvas: the heights of five or nine
    points, by touch, by your eye or from marks, make a map that every stroke follows.
    """
    from rich.console import Console

    from frida_painter.brush.kinds import brush_kind
    from frida_painter.calibration import PROCEDURES
    from frida_painter.easel.connecting import connect_easel
    from frida_painter.system.devices import prepare_process
    from frida_painter_calibration.calibrating import (
        CalibrationSetup,
        calibrate_one,
        default_record,
        easel_of,
        record_to_renew,
    )
    from frida_painter_cli.terminal import terminal_at

    if what is not What.surface and (surface.heights or surface.marks or surface.picture):
        raise ConfigError("--heights, --marks and --picture are for calibrate surface; leave them out.")
    prepare_process()
    with easel_of(easel.describe(placement_error)) as here, ExitStack() as stack:
        path = (record or default_record(here.calibration.easel)).absolute()
        known = record_to_renew(path, here.calibration, anew=what in (What.start, What.all))
        ask = ask or not here.simulated
        console = Console(stderr=True, highlight=False)
        terminal = terminal_at(path.parent, console)
        answer = terminal.answer if ask else _take_proposal
        if surface.heights is None and surface.picture is None:
            stack.callback(here.robot.close)
            stack.callback(here.camera.close)
            here = connect_easel(here, answer if ask else None, terminal.tell)
        for name in {What.all: PROCEDURES, What.start: ("canvas", "robot")}.get(what, (what.value,)):
            if name == "color" and what is What.all and not _is_older(known.done.get("color"), known.done["canvas"]):
                continue  # the photograph of the canvas showed a card of colours
            # A dialogue would overwrite a line of progress.
            with nullcontext() if ask else console.status(f"{name} ...") as line:
                setup = CalibrationSetup(
                    here, brush_kind(easel.brush), path, easel.seed, count,
                    line.update if line else lambda words: None, refill_every, surface,
                )  # fmt: skip
                finding, known = calibrate_one(name, setup, known, answer)
            print(f"{name}: {finding.sentence}")
            if finding.picture is not None:
                print(f"  {setup.beside(name, 'png')}")
    print(f"The record: {path}")


def markers(
    canvas: Annotated[
        CanvasSize, taking("SIZE", "Canvas size, width x height, in in, cm or mm, or a name.", parser=CanvasSize.parse)
    ],
    paper: Annotated[str, taking("SIZE", "Paper of the printer: A4 or letter.")] = "A4",
    out: Annotated[Path, taking("FILE", "The PDF to write.", parser=out_file)] = Path("markers.pdf"),
) -> None:
    """Write a sheet to print and cut: markers around the canvas, with which one photograph calibrates the camera.

    The pieces lie at the canvas's corners and stay there. Then every photograph tells by itself where the canvas is,
    also one of a telephone, and whether camera or canvas was moved. Without a sheet all of it works by the canvas's
    edges.
    """
    from frida_painter_calibration.marker_sheet import write_marker_sheet

    write_marker_sheet(out, canvas, CanvasSize.parse(paper))
    print(f"Print {out} at 100 %; it says what to do with the pieces.")


def _is_older(one: "Done | None", other: "Done") -> bool:
    """Returns True if a procedure was finished before another one, or never."""
    return one is None or one.turn < other.turn


def _take_proposal(question: "Question") -> "Answer":
    """Returns the proposal, as the answer of the virtual studio."""
    return question.proposal  # type: ignore[return-value]  # None if nothing was found: the procedure says what to do


def doctor(easel: EaselOptions, record: RecordOption = None) -> None:
    """Show what the robot's controller tells, the state of the calibration, and the parts there are.

    A named robot is asked for its settings, without motion, in ten seconds: what they mean, what to change, and
    what cannot work. --workspace and --camera show the calibration as well. The exit status is 1 if painting
    would be refused.
    """
    from frida_painter.easel.kinds import is_machine
    from frida_painter_calibration.commands.controller import examine, examine_machine

    if is_machine(easel.robot):
        fit = examine_machine(easel.robot, easel.workspace)
        if easel.workspace is None or not easel.camera:
            raise typer.Exit(0 if fit else 1)
    from frida_painter_calibration.calibrating import default_record, easel_of

    with easel_of(easel.describe()) as opened:
        here = opened.calibration
    path = (record or default_record(here.easel)).absolute()
    if not examine(path, here, named=record is not None):
        raise typer.Exit(1)


# Command that lets a stopped robot move again: arm.


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
    refused: StorageError | None = None
    if not held:
        print("No robot is stopped.")
    for latch in held:
        stopped = latch.read()
        if stopped is None:
            continue  # another process has released it
        print(f"{stopped}.")
        if yes or _confirm():
            try:
                latch.release()
            except StorageError as failure:
                refused = failure
            else:
                print(f"{stopped.easel} may move again.")
                continue
        print(f"{stopped.easel} stays stopped.")
    if refused is not None:
        raise refused


def _confirm() -> bool:
    """Returns True if the person at the terminal confirms. Raises RobotStopped if nobody is there, Interrupted."""
    if not sys.stdin.isatty():
        raise RobotStopped(
            "A robot is armed by somebody who looks at it: run `frida-painter arm` in a terminal beside it, or, from a "
            "script of your own, with --yes."
        )
    from frida_painter_cli.leading import confirm  # loads tensors

    return confirm("Is nobody in its way, and is the brush free? Arm it?", default=False)


def parts(
    package: Annotated[str, typer.Argument(metavar="PACKAGE", help="The name of an installed package.")],
    example: Annotated[
        list[str] | None,
        taking(
            "NAME=TEXT",
            "The text with which a part is tried, such as mirror=left-right. May be repeated.",
            show_default=False,
        ),
    ] = None,
) -> None:
    """Try every part that a package registers, as the program would use it, and say what is wrong with each.

    No device is connected to. The exit status is 1 if a part does not conform.
    """
    from frida_painter.system.devices import prepare_process

    examples = {}
    for given in example or ():
        name, equals, text = given.partition("=")
        if not equals or not name:
            raise ConfigError(f"--example was given {given[:40]!r}; write NAME=TEXT.")
        examples[name] = text
    prepare_process()
    found = _check_parts(package, examples=examples)
    for finding in found:
        typer.echo(str(finding))
    if not all(finding.passed for finding in found):
        raise typer.Exit(1)


def register(app: typer.Typer) -> None:
    """Adds the commands."""
    app.command("markers")(markers)
    app.command("calibrate")(with_fields(calibrate))
    app.command("doctor")(with_fields(doctor))
    app.command("parts")(parts)
    app.command("arm")(arm)
