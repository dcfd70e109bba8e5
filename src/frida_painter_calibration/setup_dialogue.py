"""Whole setup of a machine as one dialogue, which the terminal and the studio's page lead.

The machine is chosen and examined, then each step is led until it succeeds, and the files are written. A face gives two
functions: one answers questions, the other hears what happened.
"""

import time
from collections.abc import Callable, Generator, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import asdict, dataclass, replace
from pathlib import Path

from frida_painter.canvas_size import CanvasSize
from frida_painter.easel.connecting import examine_robot
from frida_painter.easel.dialogue import Answer, Choose, Confirm, EnterAddress, SetupQuestion, lead
from frida_painter.errors import CalibrationError, ConfigError, Interrupted, RobotDisconnected
from frida_painter.hardware.layout import Layout
from frida_painter.hardware.preset import Preset, find_preset, presets
from frida_painter.hardware.robot import Robot
from frida_painter.session.events import Remark
from frida_painter.session.setup_events import MachineTold, SetupStands, SetupStepBegan, SetupWritten
from frida_painter_calibration.machine_setup import STEPS, MachineSetup, SetupFiles, list_ports, setup_folder
from frida_painter_calibration.procedures.workspace import Bench

SetupEvent = SetupStands | SetupStepBegan | MachineTold | SetupWritten | Remark
Answering = Callable[[SetupQuestion], Answer]
Telling = Callable[[SetupEvent], None]


@dataclass(frozen=True)
class SetupOrder:
    """Order of a setup: what a person said before the dialogue. None is asked for, or is the preset's.

    preset: name or file
    port: serial port or address of the machine
    name: of the easel
    canvas: its size; None to mark three corners
    brush: in the holder; None for the fine one, or that of the setup that goes on
    folder: for the results; None for one per easel in the person's data
    step: the one to repeat
    anew: True to begin from the start, even if a setup was left
    """

    preset: str | None = None
    port: str | None = None
    name: str | None = None
    canvas: CanvasSize | None = None
    brush: str | None = None
    folder: Path | None = None
    step: str | None = None
    anew: bool = False


def lead_setup(
    order: SetupOrder,
    answer: Answering,
    tell: Telling,
    *,
    stops: Path | None = None,
    opened: Callable[[Robot], object] = lambda robot: None,
) -> SetupFiles | None:
    """Sets a machine up, from its choice to the written files; returns None for a person's hand, which needs no setup.

    stops: folder of a stop file; None if there is none
    opened: receives the robot before it moves

    Raises Interrupted if the person leaves; the same order continues. Raises ConfigError, CalibrationError,
    StorageError, RobotError and its subclasses.
    """
    begun = time.monotonic()
    known = lead(take_up(order), answer)
    if known is None:
        tell(Remark("Your hand needs no setup. Paint with: frida-painter paint PHOTO --robot human --camera opencv:0"))
        return None
    if order.step is not None:
        known.repeat(order.step)
    if known.state.done or order.step is not None:
        done = ", ".join(known.state.done) or "nothing"
        tell(Remark(f"The setup in {known.folder} goes on. Done: {done}."))
    tell(_stand(known))
    with connect_bench(known, answer, tell, may_ask=order.port is None, stops=stops) as bench:
        opened(bench.easel.robot)
        known.settle_zero(bench, answer)
        known.try_lift(bench, answer)
        for step in known.state.todo:
            lead_step(known, step, bench, answer, tell)
            if step == "strokes":
                tell(Remark(f"Test strokes painted {(time.monotonic() - begun) / 60:.0f} minutes after the start."))
        bench.pass_over("home", known.state.layout.home)
    files = known.write()
    tell(_conclude(known, files))
    return files


# Choice of the machine.


def take_up(order: SetupOrder) -> Generator[SetupQuestion, Answer, MachineSetup | None]:
    """Returns the setup that goes on, or a new one; None for a person's hand, which needs no setup.

    Raises ConfigError if the order contradicts the setup that goes on, or if something is missing.
    """
    if order.step is not None and order.step not in STEPS:
        raise ConfigError(f"--step was given {order.step[:40]!r}; the steps are {', '.join(STEPS)}.")
    there = order.folder or (setup_folder(order.name) if order.name else None)
    source = order.preset
    if source is None and not (there and MachineSetup.exists(there) and not order.anew):
        source = yield from choose_preset()
    here = there or setup_folder(Path(source or "").stem)
    if MachineSetup.exists(here) and not order.anew:
        left = MachineSetup.resume(here)
        _require_same(order, left)
        if order.port is not None:  # a serial port is called otherwise when it is plugged in again
            left.state = replace(left.state, where=order.port)
        return left
    assert source is not None
    preset = find_preset(source)
    if (needed := preset.needed) is not None:
        raise ConfigError(f"{preset.title} needs a package; install it with: {needed.command}")
    for sentence in preset.before:
        if not (yield Confirm(f"{sentence} Done?")):
            raise Interrupted(f"Nothing was begun. First: {sentence}")
    if not preset.is_machine:
        return None
    where = order.port or (yield from choose_place(preset))
    name, brush = order.name or preset.name, order.brush or "fine"
    return MachineSetup.begin(here, preset, source, where, name, brush, order.canvas)


def _require_same(order: SetupOrder, left: MachineSetup) -> None:
    """Raises ConfigError if the order says something else than the setup that goes on."""
    state = left.state
    preset = order.preset
    kept = str(Path(preset).absolute()) if preset is not None and preset.endswith(".toml") else preset
    said = {
        "preset": (kept, state.preset),
        "name": (order.name, state.layout.easel),
        "canvas": (order.canvas, state.size),
        "brush": (order.brush, state.brush),
    }
    for what, (wanted, begun) in said.items():
        if wanted is not None and wanted != begun:
            raise ConfigError(
                f"The setup in {left.folder} was begun with the {what} {begun or 'to be measured'}, and {wanted} is "
                f"asked for now; leave the {what} out to go on, or begin from the start (--anew)."
            )


def choose_preset() -> Generator[SetupQuestion, Answer, str]:
    """Returns the name of the preset that the person chose."""
    known = [*presets().values()]
    chosen = yield Choose(
        "Which machine is it?",
        tuple(preset.title for preset in known),
        notes=tuple(map(_describe, known)),
        drawings=tuple(preset.lift.by for preset in known),
    )
    return known[_index(chosen)].name


def _describe(preset: Preset) -> str:
    if preset.area is None:
        return "you paint, the program shows each stroke"
    width, height, _ = (1000 * (high - low) for low, high in zip(preset.area.lower, preset.area.upper, strict=True))
    return f"{width:.0f} x {height:.0f} mm, {'serial port' if preset.connection == 'serial' else 'network'}"


def choose_place(preset: Preset) -> Generator[SetupQuestion, Answer, str]:
    """Returns the port or address that the person chose or typed. Raises ConfigError if pyserial is missing."""
    if preset.connection == "network":
        return str((yield EnterAddress("Its address on the network (like 192.168.1.10)")))
    ports = list_ports(preset)
    typed = EnterAddress("The name of its port (like /dev/ttyUSB0)", port=True)
    if not ports:
        none = "No serial port was found. Plug the machine in, switch it on and look at its cable"
        return str((yield replace(typed, text=f"{none}; then leave and begin again, or type the name of its port.")))
    likely = [port for port in ports if port.likely]
    chosen = yield Choose(
        "At which port is it?",
        (*(port.name for port in ports), "Another one"),
        0 if len(likely) == 1 else None,
        notes=(*(port.text for port in ports), "you type its name"),
    )
    return ports[_index(chosen)].name if _index(chosen) < len(ports) else str((yield typed))


def _index(answer: Answer) -> int:
    assert isinstance(answer, int)
    return answer


# Connection, steps and result.


@contextmanager
def connect_bench(
    known: MachineSetup, answer: Answering, tell: Telling, *, may_ask: bool, stops: Path | None = None
) -> Iterator[Bench]:
    """Examines and connects the machine; gives it for the steps.

    may_ask: True to ask for another port if something else answers at the first one

    Raises ConfigError if the machine cannot paint like this. Raises RobotError and its subclasses, StorageError.
    """
    serial = known.preset.connection == "serial"
    with ExitStack() as stack:
        while True:
            tell(Remark(f"Connecting {known.robot} ..."))
            try:
                _examine(known, answer, tell)
                bench = stack.enter_context(known.bench(stops))
                break
            except RobotDisconnected as other:
                if not (may_ask and serial):
                    raise
                tell(Remark(str(other)))
                where = lead(choose_place(known.preset), answer)
                known.state = replace(known.state, where=where)
        known.save()
        yield bench


def _examine(known: MachineSetup, answer: Answering, tell: Telling) -> None:
    """Tells what the controller says, and asks what only a person knows of it; once, as long as nothing is done.

    Raises ConfigError if painting cannot work like this, RobotError.
    """
    found = examine_robot(known.robot, known.state.layout.workcell().workspace)
    if found is None:
        return
    tell(MachineTold([asdict(fact) for fact in found.facts]))
    refusals = [fact.text for fact in found.facts if fact.weight == "refusal"]
    asked = [fact for fact in found.facts if fact.question and not known.state.done]
    refusals += [fact.text for fact in asked if answer(Confirm(fact.question)) is not True]
    if refusals:
        raise ConfigError(f"The machine cannot paint like this: {' '.join(refusals)} Then begin the setup again.")


def lead_step(known: MachineSetup, step: str, bench: Bench, answer: Answering, tell: Telling) -> None:
    """Leads one step, again and again until it succeeds. Raises Interrupted if the person leaves, RobotError."""
    tell(SetupStepBegan(step))
    while True:
        try:
            known.perform(step, bench, answer)
        except (CalibrationError, ConfigError) as refused:
            tell(Remark(str(refused)))
            if not answer(Confirm("Do this step again?")):
                raise Interrupted(f"The setup was left; it continues at the step {step} next time.") from refused
            continue
        except Interrupted as left:
            raise Interrupted(f"{left} The setup continues at the step {step} next time.") from left
        tell(_stand(known))
        return


def _stand(known: MachineSetup) -> SetupStands:
    done = known.state.done
    steps = [{"name": name, "text": text, "done": name in done} for name, text in STEPS.items()]
    layout = known.state.layout
    return SetupStands(known.preset.title, known.robot, layout.easel, steps, _table(layout))


def _table(layout: Layout) -> dict[str, object]:
    """Returns the places of a layout from above, in millimetres of the robot's frame."""

    def flat(place: tuple[float, ...]) -> list[float]:
        return [round(1000 * place[0], 2), round(1000 * place[1], 2)]

    return {
        "lower": flat(layout.lower),
        "upper": flat(layout.upper),
        "canvas": [*map(flat, layout.corners().values())],
        "wells": [*map(flat, layout.paint.wells)],
        "water": flat(layout.paint.water),
        "rag": flat(layout.paint.rag),
    }


def _conclude(known: MachineSetup, files: SetupFiles) -> SetupWritten:
    given = f"--robot {known.robot}"
    place, record = f"--workspace {files.workspace}", f"--calibration {files.record}"
    paint = (
        f"frida-painter paint PHOTO {given} --camera none {place} {record} --brush {known.state.brush} "
        f"--colors {len(known.state.layout.paint.wells)}"
    )
    commands = [
        ("Paint without a camera", paint),
        ("Paint from the studio's page", f"frida-painter studio {given} --camera none {place} {record}"),
        ("With a camera, calibrate it first", f"frida-painter calibrate all {given} --camera opencv:0 {place}"),
    ]
    told = [{"about": about, "command": command} for about, command in commands]
    return SetupWritten(str(files.workspace), str(files.record), str(files.sheet), told)
