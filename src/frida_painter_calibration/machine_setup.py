"""Setup of a machine: its steps in order, what they found so far, and the files that they lead to.

A folder keeps the state after each step, so that the setup can be left at any moment and continued. The faces lead the
dialogues; the steps themselves are in procedures/workspace.py.
"""

import json
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, Self

from pydantic import ConfigDict, TypeAdapter, ValidationError

from frida_painter import images, storage
from frida_painter.brush.kinds import brush_kind
from frida_painter.calibration import Calibration, SurfaceMap
from frida_painter.canvas_size import CanvasSize
from frida_painter.easel.dialogue import Answer, SetupQuestion, lead
from frida_painter.easel.kinds import NO_CAMERA, state_folder
from frida_painter.easel.order import EaselOrder
from frida_painter.easel.parent import EaselProcess
from frida_painter.errors import ConfigError
from frida_painter.hardware.layout import Layout
from frida_painter.hardware.preset import Preset, find_preset
from frida_painter.hardware.robot import Feeler
from frida_painter_calibration.calibrating import default_record, record_to_renew
from frida_painter_calibration.procedures.workspace import (
    Bench,
    find_touch,
    map_surface,
    mark_canvas,
    mark_paint,
    paint_test,
    settle_zero,
    trace,
    try_lift,
)
from frida_painter_calibration.sheets.machine_sheet import draw_machine

STEPS = {
    "canvas": "mark the corners of the canvas",
    "touch": "find the lightest touch and the hardest press",
    "surface": "measure the canvas if it is uneven",
    "paint": "mark the wells, the water and the rag",
    "trace": "trace the outlines in the air",
    "strokes": "paint three test strokes",
}
"""Steps of a setup in their order, and what a person does in each."""
_ACCURACY = 0.0002  # metres of the heights
_FORMAT, _VERSION = "frida-painter setup", 1
_DRAFT, _STATE = "draft.toml", "setup.json"
WORKSPACE, RECORD, SHEET = "workspace.toml", "calibration.json", "setup.png"


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

    @property
    def todo(self) -> tuple[str, ...]:
        """Steps that are not finished, in order."""
        return tuple(step for step in STEPS if step not in self.done)


@dataclass(frozen=True)
class SetupFiles:
    """Files that a setup wrote: workspace, calibration record, and the picture of both."""

    workspace: Path
    record: Path
    sheet: Path


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
        kept = str(Path(source).absolute()) if source.endswith(".toml") else source
        return cls(folder, SetupState(kept, where, brush, Layout.propose(preset, easel, size), size), preset)

    @classmethod
    def resume(cls, folder: Path) -> Self:
        """Continues the setup of a folder. Raises ConfigError if its state is damaged or its preset is gone."""
        path = folder / _STATE
        values = storage.read_json(path, "the state of a setup", ConfigError)
        advice = "say --anew to begin from the start"
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

    @classmethod
    def exists(cls, folder: Path) -> bool:
        """Returns True if a setup was begun in the folder."""
        return (folder / _STATE).exists()

    @property
    def robot(self) -> str:
        """Name of the machine for --robot."""
        return self.preset.robot_name(self.state.where)

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
        draft = self.folder / _DRAFT
        storage.write_text(draft, self.state.layout.draft())
        order = EaselOrder(
            robot=self.robot,
            canvas=self.state.layout.canvas,
            brushes=(self.state.brush,),
            seed=0,
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
                feels = easel.robot.feels() if may_feel and isinstance(easel.robot, Feeler) else None
                yield Bench(easel, self.state.layout, feels, self.state.surface)
            finally:
                easel.robot.close()

    def settle_zero(self, bench: Bench, answer: Callable[[SetupQuestion], Answer]) -> None:
        """Has a person find the machine's zero if it was lost. Raises ZeroUnknown, RobotError and its subclasses."""
        corner = self.preset.probe.corner if self.preset.probe is not None else None
        lead(settle_zero(bench, corner, marked="canvas" in self.state.done), answer)

    def try_lift(self, bench: Bench, answer: Callable[[SetupQuestion], Answer]) -> None:
        """Has a person see whether a servo lifts the brush, once: no controller can tell.

        Raises ConfigError if it does not, RobotError and its subclasses.
        """
        if self.preset.lift.by == "servo" and not self.state.done:
            lead(try_lift(bench), answer)

    def perform(self, step: str, bench: Bench, answer: Callable[[SetupQuestion], Answer]) -> None:
        """Leads a step's dialogue, and keeps what it found.

        Raises CalibrationError or ConfigError if the step must be repeated, Interrupted if the person leaves,
        RobotError and its subclasses.
        """
        layout, measured = self.state.layout, self.state.surface
        match step:
            case "canvas":
                layout = lead(mark_canvas(bench, self.state.size), answer)
            case "touch":
                layout = lead(find_touch(bench), answer)
            case "surface":
                measured = lead(map_surface(bench), answer)
                layout = replace(layout, uneven=(measured.lowest, measured.highest) if measured else (0.0, 0.0))
            case "paint":
                layout = lead(mark_paint(bench), answer)
            case "trace":
                lead(trace(bench), answer)
            case "strokes":
                self._test(bench, answer)
            case _:
                raise ConfigError(f"There is no step {step[:40]!r}; the steps are {', '.join(STEPS)}.")
        layout.workcell()
        bench.layout, bench.surface = layout, measured
        self.state = replace(self.state, layout=layout, surface=measured, done=(*self.state.done, step))
        self.save()

    def _test(self, bench: Bench, answer: Callable[[SetupQuestion], Answer]) -> None:
        if not lead(paint_test(bench, brush_kind(self.state.brush)), answer):
            raise ConfigError("The test strokes were not right; repeat the touch or the canvas, then paint them again.")

    def write(self) -> SetupFiles:
        """Writes workspace, calibration record and their picture. Raises StorageError, CalibrationError."""
        layout = self.state.layout
        workcell = layout.workcell()
        files = SetupFiles(self.folder / WORKSPACE, self.folder / RECORD, self.folder / SHEET)
        storage.write_text(files.workspace, layout.toml())
        record = self.record(files.record)
        record.save(files.record)
        images.save(draw_machine(workcell.workspace, record, self.preset.title, self.robot), files.sheet)
        return files

    def record(self, path: Path) -> Calibration:
        """Returns the easel's record with the heights of the brush, with all else that the file `path` has."""
        layout = self.state.layout
        default = layout.workcell().calibration(self.state.brush, camera=NO_CAMERA)
        known = record_to_renew(path, default, anew=False)
        return replace(known, canvas=layout.canvas, surface=self.state.surface).with_brush(
            self.state.brush, layout.touch, layout.press, protrusion=known.protrusion, residual=_ACCURACY
        )


# Serial ports of this computer.


@dataclass(frozen=True)
class SerialPort:
    """Serial port of this computer.

    name: as it is opened
    text: what the system says of it
    likely: True if its USB ids are those of the preset's machines
    """

    name: str
    text: str
    likely: bool


def list_ports(preset: Preset) -> list[SerialPort]:
    """Returns the serial ports, the likely ones for the preset first. Raises ConfigError if pyserial is missing."""
    if preset.needed is not None:
        raise ConfigError(f"{preset.title} needs a package; install it with: {preset.needed.command}")
    from serial.tools.list_ports import comports

    found = [_describe_port(port, preset) for port in comports()]
    return sorted(found, key=lambda port: (not port.likely, port.name))


def _describe_port(port: Any, preset: Preset) -> SerialPort:
    ids = f"{port.vid:04x}:{port.pid:04x}" if port.vid is not None and port.pid is not None else ""
    about = ", ".join(part for part in (port.description, port.manufacturer, ids) if part and part != "n/a")
    return SerialPort(port.device, about or "no description", ids in preset.usb)


def setup_folder(easel: str) -> Path:
    """Returns the default folder of an easel's setup, which also holds its calibration record."""
    return default_record(easel).parent
