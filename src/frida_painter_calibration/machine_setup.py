"""Whole setup of a machine as one dialogue, which the terminal and the studio's page lead.

The machine is chosen and examined, then each step of procedures/workspace.py is led until it succeeds, and the files
are written. A folder keeps the state after each step, so that the setup can be left at any moment and continued. A
face gives two functions: one answers questions, the other hears what happened.
"""

import json
import time
from collections.abc import Callable, Generator, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Self

import numpy as np
from pydantic import ConfigDict, TypeAdapter, ValidationError

from frida_painter.brush.kinds import brush_kind
from frida_painter.calibration import SurfaceMap
from frida_painter.canvas_size import CanvasSize
from frida_painter.easel.connecting import examine_robot
from frida_painter.easel.dialogue import Answer, Choose, Confirm, EnterAddress, SetupQuestion, lead
from frida_painter.easel.kinds import NO_CAMERA, state_folder
from frida_painter.easel.order import EaselOrder
from frida_painter.easel.parent import EaselProcess
from frida_painter.errors import CalibrationError, ConfigError, Interrupted, RobotDisconnected
from frida_painter.hardware.preset import Layout, Preset, find_preset, presets
from frida_painter.hardware.robot import Robot, TouchProbe
from frida_painter.hardware.timing import TravelLimits
from frida_painter.hardware.workcell import Bounds
from frida_painter.report.sheets import workspace_plan
from frida_painter.session.events import Began, Remark, ResultFound
from frida_painter.system import images, storage
from frida_painter_calibration.calibrating import default_record, record_to_renew
from frida_painter_calibration.options import SetupOrder
from frida_painter_calibration.procedures.surface import surface_sheet
from frida_painter_calibration.procedures.workspace import STEPS, Bench, settle_zero, try_lift

_ACCURACY = 0.0002  # metres of the heights
_FORMAT, _VERSION = "frida-painter setup", 2
_DRAFT, _STATE = "draft.toml", "setup.json"
WORKSPACE, RECORD, SHEET, SURFACE = "workspace.toml", "calibration.json", "setup.png", "surface.png"

SetupEvent = Began | ResultFound | Remark
Answering = Callable[[SetupQuestion], Answer]


def lead_setup(
    order: SetupOrder,
    answer: Answering,
    tell: Callable[[SetupEvent], None],
    *,
    stops: Path | None = None,
    opened: Callable[[Robot], object] = lambda robot: None,
) -> None:
    """Sets a machine up, from its choice to the written files; a person's hand needs no setup.

    stops: folder of a stop file; None if there is none
    opened: receives the robot before it moves

    Raises Interrupted if the person leaves; the same order continues. Raises ConfigError, CalibrationError,
    StorageError, RobotError and its subclasses.
    """
    begun = time.monotonic()
    known = lead(take_up(order), answer)
    if known is None:
        tell(Remark("Your hand needs no setup. Paint with: frida-painter paint PHOTO --robot human --camera opencv:0"))
        return
    if order.step is not None:
        known.repeat(order.step)
    if known.state.done or order.step is not None:
        tell(Remark(f"The setup in {known.folder} goes on. Done: {', '.join(known.state.done) or 'nothing'}."))
    tell(known.describe())
    with ExitStack() as stack:
        while True:
            tell(Remark(f"Connecting {known.robot} ..."))
            try:
                tell_machine(known, answer, tell)
                bench = stack.enter_context(known.bench(stops))
                break
            except RobotDisconnected as other:  # something else may answer at that port
                if order.port is not None or known.preset.connection != "serial":
                    raise
                tell(Remark(str(other)))
                known.state = replace(known.state, where=lead(choose_place(known.preset), answer))
        known.save()
        opened(bench.easel.robot)
        probe = known.preset.probe
        lead(settle_zero(bench, probe.corner if probe else None, marked="canvas" in known.state.done), answer)
        free = Confirm("From now on the tip moves, first up, then across. Is its way free?", moves=True)
        if answer(free) is not True:
            raise Interrupted("The setup was left, and the tip was not moved; the same command continues.")
        if known.preset.lift.by == "servo" and not known.state.done:
            lead(try_lift(bench), answer)
        for step in STEPS:
            if step not in known.state.done:
                tell(Began("step", step))
                known.lead_step(step, bench, answer, tell)
                if step == "strokes":
                    minutes = (time.monotonic() - begun) / 60
                    tell(Remark(f"Test strokes painted {minutes:.0f} minutes after the start."))
        bench.pass_over("home", known.state.layout.workspace.home or bench.tip())
    tell(known.write())


# Choice of the machine.


def take_up(order: SetupOrder) -> Generator[SetupQuestion, Answer, "MachineSetup | None"]:
    """Returns the setup that goes on, or a new one; None for a person's hand, which needs no setup.

    Raises ConfigError if the order contradicts the setup that goes on, or if something is missing.
    """
    if order.step is not None and order.step not in STEPS:
        raise ConfigError(f"--step was given {order.step[:40]!r}; the steps are {', '.join(STEPS)}.")
    there = order.folder or (default_record(order.name).parent if order.name else None)
    source = order.preset
    if source is None and not (there and (there / _STATE).exists() and not order.anew):
        source = yield from _choose_preset()
    here = there or default_record(Path(source or "").stem).parent
    if (here / _STATE).exists() and not order.anew:
        left = MachineSetup.resume(here)
        left.require_same(order)
        if order.port is not None:  # a serial port is called otherwise when it is plugged in again
            left.state = replace(left.state, where=order.port)
        return left
    assert source is not None
    preset = find_preset(source)
    _require_package(preset)
    for sentence in preset.before:
        if not (yield Confirm(f"{sentence} Done?")):
            raise Interrupted(f"Nothing was begun. First: {sentence}")
    if not preset.is_machine:
        return None
    where = order.port or (yield from choose_place(preset))
    name, brush = order.name or preset.name, order.brush or "fine"
    return MachineSetup.begin(here, preset, source, where, name, brush, order.canvas)


def _require_package(preset: Preset) -> None:
    if preset.needed is not None:
        raise ConfigError(preset.needed.advice(preset.title))


def _choose_preset() -> Generator[SetupQuestion, Answer, str]:
    """Returns the name of the preset that the person chose."""
    known, notes = [*presets().values()], []
    for preset in known:
        if preset.area is None:
            notes.append("you paint, the program shows each stroke")
            continue
        width, height, _ = (1000 * (high - low) for low, high in zip(preset.area.lower, preset.area.upper, strict=True))
        notes.append(f"{width:.0f} x {height:.0f} mm, {'serial port' if preset.connection == 'serial' else 'network'}")
    titles, drawings = tuple(preset.title for preset in known), tuple(preset.lift.by for preset in known)
    chosen = yield Choose("Which machine is it?", titles, notes=tuple(notes), drawings=drawings)
    assert isinstance(chosen, int)
    return known[chosen].name


def choose_place(preset: Preset) -> Generator[SetupQuestion, Answer, str]:
    """Returns the port or address that the person chose or typed. Raises ConfigError if pyserial is missing."""
    if preset.connection == "network":
        return str((yield EnterAddress("Its address on the network (like 192.168.1.10)")))
    ports = list_ports(preset)
    typed = EnterAddress("The name of its port (like /dev/ttyUSB0, or socket://192.168.1.10:23)", port=True)
    if not ports:
        none = "No serial port was found. Plug the machine in, switch it on and look at its cable"
        return str((yield replace(typed, text=f"{none}; then leave and begin again, or type the name of its port.")))
    names, notes, likely = zip(*ports, strict=True)
    proposal = 0 if sum(likely) == 1 else None
    chosen = yield Choose(
        "At which port is it?", (*names, "Another one"), proposal, notes=(*notes, "you type its name")
    )
    assert isinstance(chosen, int)
    return names[chosen] if chosen < len(names) else str((yield typed))


def list_ports(preset: Preset) -> list[tuple[str, str, bool]]:
    """Returns name and description of this computer's serial ports, and whether one has the ids of the preset's boards.

    Those come first. Raises ConfigError if pyserial is missing.
    """
    _require_package(preset)
    from serial.tools.list_ports import comports

    found = []
    for port in comports():
        ids = f"{port.vid:04x}:{port.pid:04x}" if port.vid is not None and port.pid is not None else ""
        about = ", ".join(part for part in (port.description, port.manufacturer, ids) if part and part != "n/a")
        found.append((_name_port(port.device), about or "no description", ids in preset.usb))
    return sorted(found, key=lambda port: (not port[2], port[0]))


def _name_port(device: str) -> str:
    """Returns the link that holds a device's serial number, which stays when it is plugged in anew; else its name."""
    links = (link for link in Path("/dev/serial/by-id").glob("*") if str(link.resolve()) == device)
    return str(next(links, device))


def tell_machine(known: "MachineSetup", answer: Answering, tell: Callable[[SetupEvent], None]) -> None:
    """Tells what the controller says, and asks what only a person knows of it; once, as long as nothing is done.

    Raises ConfigError if painting cannot work like this, RobotError.
    """
    found = examine_robot(known.robot, known.state.layout.workcell().workspace)
    if found is None:
        return
    tell(ResultFound("facts", detail={"facts": [asdict(fact) for fact in found.facts]}))
    if found.travel is not None and found.homes and not known.state.done:
        known.learn_travel(found.travel)
    refusals = [fact.text for fact in found.facts if fact.weight == "refusal"]
    asked = [fact for fact in found.facts if fact.question and not known.state.done]
    refusals += [fact.text for fact in asked if answer(Confirm(fact.question)) is not True]
    if refusals:
        raise ConfigError(f"The machine cannot paint like this: {' '.join(refusals)} Then begin the setup again.")


# State of a setup, its steps and its files.


@dataclass(frozen=True)
class SetupState:
    """State of a setup.

    preset: its name, or the path of its file
    where: port or address of the machine
    brush: in the holder
    layout: what is known so far
    size: of the canvas if a person said it; None if three corners are marked
    surface: height map of an uneven canvas; None if it is flat
    done: finished steps
    """

    __pydantic_config__ = ConfigDict(extra="forbid")

    preset: str
    where: str
    brush: str
    layout: Layout
    size: CanvasSize | None = None
    surface: SurfaceMap | None = None
    done: tuple[str, ...] = ()


class MachineSetup:
    """Setup of a machine in a folder: begun anew or continued."""

    def __init__(self, folder: Path, state: SetupState, preset: Preset) -> None:
        self.folder, self.state, self.preset = folder.absolute(), state, preset

    @classmethod
    def begin(
        cls, folder: Path, preset: Preset, source: str, where: str, easel: str, brush: str, size: CanvasSize | None
    ) -> Self:
        """Begins a setup; nothing is written yet.

        source: name or file of the preset
        Raises ConfigError if the canvas does not fit into the machine's area, or if the brush is unknown.
        """
        brush_kind(brush)
        return cls(folder, SetupState(_keep(source), where, brush, Layout.propose(preset, easel, size), size), preset)

    @classmethod
    def resume(cls, folder: Path) -> Self:
        """Continues the setup of a folder. Raises ConfigError if its state is damaged or its preset is gone."""
        path, advice = folder / _STATE, "say --anew to begin from the start"
        values = storage.read_json(path, "the state of a setup", ConfigError)
        if (values.pop("format", None), values.pop("version", None)) != (_FORMAT, _VERSION):
            raise ConfigError(f"{path} is not the state of a setup of this version; {advice}.")
        try:
            state = TypeAdapter(SetupState).validate_json(json.dumps(values), strict=True)
        except ValidationError as error:
            fault = error.errors()[0]
            where = ".".join(map(str, fault["loc"]))
            raise ConfigError(f"{path}: {where} is not as it must be ({fault['msg'].lower()}); {advice}.") from error
        if unknown := [step for step in state.done if step not in STEPS]:
            raise ConfigError(f"{path} has an unknown step {unknown[0][:40]!r}; {advice}.")
        return cls(folder, state, find_preset(state.preset))

    def require_same(self, order: SetupOrder) -> None:
        """Raises ConfigError if the order says something else than this setup, which goes on."""
        state = self.state
        said = {
            "preset": (order.preset and _keep(order.preset), state.preset),
            "name": (order.name, state.layout.easel),
            "canvas": (order.canvas, state.size),
            "brush": (order.brush, state.brush),
        }
        for what, (wanted, begun) in said.items():
            if wanted is not None and wanted != begun:
                raise ConfigError(
                    f"The setup in {self.folder} was begun with the {what} {begun or 'to be measured'}, and {wanted} "
                    f"is asked for now; leave the {what} out to go on, or begin from the start (--anew)."
                )

    @property
    def robot(self) -> str:
        """Name of the machine for --robot."""
        return self.preset.robot_name(self.state.where)

    def learn_travel(self, travel: TravelLimits) -> None:
        """Takes the machine's own limits for the box of the preset, whose floor stays. Raises ConfigError."""
        area = self.preset.area
        assert area is not None
        ends = np.array([travel.lower, travel.upper, area.lower, area.upper])
        lower, upper = np.where(np.isfinite(ends[:2]), ends[:2], ends[2:]).tolist()
        lower[2] = max(lower[2], area.lower[2])
        own = self.preset.model_copy(update={"area": Bounds(lower=tuple(lower), upper=tuple(upper))})
        try:
            layout = Layout.propose(own, self.state.layout.easel, self.state.size)
        except ConfigError as error:
            raise ConfigError(
                f"The machine's own limits ({', '.join(map(travel.describe, range(3)))} in x, y, z) do not fit this "
                f"preset: {error} Set its work zero as the preset says, then begin again."
            ) from error
        self.state = replace(self.state, layout=layout)

    def save(self) -> None:
        """Writes the state. Raises StorageError."""
        storage.write_json(self.folder / _STATE, {"format": _FORMAT, "version": _VERSION, **asdict(self.state)})

    def repeat(self, step: str) -> None:
        """Makes a step unfinished, with those that rest on it. Raises StorageError."""
        again = {step, "trace", "strokes"} if step != "strokes" else {step}
        measured = self.state.surface
        if step in ("canvas", "touch"):  # the map rests on both
            again, measured = again | {"surface"}, None
        done = tuple(one for one in self.state.done if one not in again)
        self.state = replace(self.state, surface=measured, done=done)
        self.save()

    @contextmanager
    def bench(self, stops: Path | None = None) -> Iterator[Bench]:
        """Opens the machine in its own process and connects it; gives it for the steps. Its zero may be lost.

        stops: folder of a stop file, at which the machine's process stops it; None if there is none
        Raises RobotStopped if a person must arm it first, RobotBusy, RobotError and its subclasses, ConfigError.
        """
        draft, state = self.folder / _DRAFT, self.state
        storage.write_text(draft, state.layout.toml(draft=True))
        order = EaselOrder(
            robot=self.robot,
            canvas=state.layout.canvas,
            brushes=(state.brush,),
            state=state_folder(),
            folder=stops,
            workspace=draft.absolute(),
            camera=NO_CAMERA,
        )
        with EaselProcess() as process:
            easel = process.open(order)
            try:
                easel.robot.connect()
                may_feel = self.preset.probe is not None and self.preset.probe.touch != "jog"
                feels = easel.robot.feels() if may_feel and isinstance(easel.robot, TouchProbe) else None
                yield Bench(easel, state.layout, feels, state.surface, state.size)
            finally:
                easel.robot.close()

    def lead_step(self, step: str, bench: Bench, answer: Answering, tell: Callable[[SetupEvent], None]) -> None:
        """Leads a step until it succeeds, and keeps what it found.

        Raises Interrupted if the person leaves, RobotError and its subclasses.
        """
        while True:
            found = replace(bench)  # a step that fails changes nothing
            try:
                lead(STEPS[step][1](found), answer)
                found.layout.workcell()
                break
            except (CalibrationError, ConfigError) as refused:
                tell(Remark(str(refused)))
                if not answer(Confirm("Do this step again?", moves=True)):
                    raise Interrupted(f"The setup was left; it continues at the step {step} next time.") from refused
            except Interrupted as left:
                raise Interrupted(f"{left} The setup continues at the step {step} next time.") from left
        bench.layout, bench.surface = found.layout, found.surface
        done = (*self.state.done, step)
        self.state = replace(self.state, layout=found.layout, surface=found.surface, done=done)
        self.save()
        tell(self.describe())

    def describe(self) -> ResultFound:
        """Returns the state for a face: the steps, and the table from above in millimetres of the robot's frame."""
        done, layout = self.state.done, self.state.layout

        def flat(place: tuple[float, ...]) -> list[float]:
            return [round(1000 * place[0], 2), round(1000 * place[1], 2)]

        steps = [{"name": name, "text": text, "done": name in done} for name, (text, _) in STEPS.items()]
        table = {
            "lower": flat(layout.workspace.lower),
            "upper": flat(layout.workspace.upper),
            "canvas": [*map(flat, layout.corners().values())],
            "wells": [*map(flat, layout.workspace.wells)],
            "water": flat(layout.workspace.water),
            "rag": flat(layout.workspace.rag),
        }
        told = {"title": self.preset.title, "robot": self.robot, "easel": layout.easel, "steps": steps, "table": table}
        return ResultFound("machine", detail=told)

    def write(self) -> ResultFound:
        """Writes workspace, calibration record and pictures. Raises StorageError, CalibrationError."""
        layout, brush = self.state.layout, self.state.brush
        workspace, path, sheet = (self.folder / name for name in (WORKSPACE, RECORD, SHEET))
        storage.write_text(workspace, layout.toml())
        workcell = layout.workcell()
        known = record_to_renew(path, workcell.calibration(brush, camera=NO_CAMERA), anew=False)
        record = replace(known, canvas=layout.canvas, surface=self.state.surface).with_brush(
            brush, layout.touch, layout.press, protrusion=known.protrusion, residual=_ACCURACY
        )
        record.save(path)
        images.save(workspace_plan(workcell.workspace, layout.canvas, layout.easel), sheet)
        if record.surface is not None:
            images.save(surface_sheet(record.surface), self.folder / SURFACE)
        robot, place, measured = f"--robot {self.robot}", f"--workspace {workspace}", f"--calibration {path}"
        paint = f"frida-painter paint PHOTO {robot} --camera none {place} {measured} --brush {brush}"
        commands = {
            "Paint without a camera": f"{paint} --colors {len(layout.workspace.wells)}",
            "Paint from the studio's page": f"frida-painter studio {robot} --camera none {place} {measured}",
            "With a camera, calibrate it first": f"frida-painter calibrate all {robot} --camera opencv:0 {place}",
        }
        told = [{"about": about, "command": command} for about, command in commands.items()]
        written = {"workspace": str(workspace), "record": str(path), "sheet": str(sheet), "commands": told}
        return ResultFound("setup", detail=written)


def _keep(source: str) -> str:
    """Returns the name of a preset, or the absolute path of its file."""
    return str(Path(source).absolute()) if source.endswith(".toml") else source
