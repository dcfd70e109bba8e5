"""Work of `doctor`: what a robot's controller tells, the state of a calibration record, and the parts there are."""

import platform
import shutil
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from importlib.metadata import version
from pathlib import Path

import torch
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from frida_painter import registry
from frida_painter.brush.kinds import BrushModel, FamilyPart
from frida_painter.calibration import Calibration, previous
from frida_painter.canvas_size import CanvasSize
from frida_painter.easel.connecting import examine_robot
from frida_painter.easel.kinds import MACHINES, EaselKind, require_known
from frida_painter.errors import CalibrationError, PluginError, WeightsError
from frida_painter.hardware.kinds import CameraKind, Needed, RobotKind
from frida_painter.hardware.robot import Workspace
from frida_painter.hardware.workcell import WorkcellConfig
from frida_painter.objectives.objective import GoalKind
from frida_painter.session.opening import OLD, ProcedureStatus, adopt_camera, planning_device, require, statuses
from frida_painter.session.rehearsal import FlatbedWorkspace

_SOME_CANVAS = CanvasSize(0.3, 0.2)
_SHOWN = {"fact": "  ", "warning": "[yellow]! [/]", "refusal": "[bold red]x [/]"}


def is_machine(robot: str) -> bool:
    """Returns True if the name is that of a real robot with a controller. Raises ConfigError if it is unknown."""
    return require_known(robot) in MACHINES


def examine_machine(robot: str, workspace: Path | None) -> bool:
    """Prints what the controller of a named robot tells; nothing moves. Returns False if it cannot paint like this.

    workspace: file of the workspace, to compare its speeds; None if there is none yet

    Raises ConfigError if the name or the file is wrong, RobotBusy if a painting uses the robot, RobotError if nobody
    answers.
    """
    console = Console(highlight=False, soft_wrap=True)
    place = _some_workspace() if workspace is None else WorkcellConfig.load(workspace).workspace
    found = examine_robot(robot, place, compare=workspace is not None)
    if found is None:
        console.print(f"{escape(robot)}: its driver has no examination; connect it to see what it says.")
        return True
    facts = found.facts
    console.print(f"[bold]{escape(robot)}[/]")
    for fact in facts:
        console.print(f"{_SHOWN[fact.weight]}{escape(fact.text)}")
    fit = all(fact.weight != "refusal" for fact in facts)
    console.print("[green]It can paint.[/]" if fit else "[bold red]It cannot paint like this.[/]")
    return fit


def _some_workspace() -> Workspace:
    """Returns a workspace for a driver that is only asked questions."""
    place = FlatbedWorkspace().motion(_SOME_CANVAS).workspace
    return replace(place, home=(0.0, 0.0, place.upper[2]))


# Output of doctor: the state of a calibration record, procedure by procedure, and the parts on this machine.


def examine(path: Path, easel: Calibration, *, named: bool) -> bool:
    """Prints the state of the record at `path` for an easel whose default record is `easel`.

    named: True if a person asked for this file.
    Returns True if painting with the record is possible.
    """
    console = Console(highlight=False, soft_wrap=True)
    record, trouble = _read(path, easel, named)
    if record is not None and not trouble:
        console.print(_procedures(record, easel))
    console.print(_about(path, easel, record))
    if trouble:
        console.print(f"[bold red]Painting would be refused.[/] {_plain(trouble)}")
    elif record is None:
        console.print(
            "No record yet. The virtual studio paints without one, from what it knows of itself; "
            "to calibrate it: frida-painter calibrate all"
        )
    else:
        console.print("[bold green]Painting with this record would go ahead.[/]")
    return not trouble


def _read(path: Path, easel: Calibration, named: bool) -> tuple[Calibration | None, str]:
    """Returns the record or None, and the reason why painting with it is refused, or ""."""
    if not path.exists() and not named:
        return None, ""
    record = None
    try:
        record = adopt_camera(Calibration.load(path), easel)
        require(record, easel, ())
    except CalibrationError as reason:
        return record, str(reason)
    return record, ""


def _procedures(record: Calibration, easel: Calibration) -> Table:
    table = Table("procedure", "done", "left over", "state", box=None, padding=(0, 2, 0, 0))
    for status in statuses(record, easel):
        table.add_row(
            status.procedure,
            status.done.dated[:10] if status.done else "-",
            _residual(status),
            _state(status),
        )
    return table


def _residual(status: ProcedureStatus) -> str:
    if status.done is None:
        return "-"
    residual = status.done.residual
    return {
        "canvas": f"{residual:.2f} px",
        "robot": f"{residual * 1000:.2f} mm",
        "color": f"{residual:.1f} CIEDE2000",
        "brush": f"{residual * 1000:.2f} mm",
        "strokes": f"{residual:.4f} of the map",
    }[status.procedure]


def _state(status: ProcedureStatus) -> str:
    if status.fault:
        return f"[red]to be repeated[/]: {_plain(status.fault)}"
    if status.done is None:
        return "[dim]never done, the easel's default holds[/]"
    if status.is_old:
        return f"[yellow]good, but {status.days} days old[/] (repeat it after {OLD})"
    return "[green]good[/]"


def _about(path: Path, easel: Calibration, record: Calibration | None) -> Table:
    """Returns a table of the ids, the files and the machine."""
    table = Table(box=None, show_header=False, padding=(0, 2, 0, 0))
    kept = f" (the one before: {previous(path).name})" if previous(path).exists() else ""
    table.add_row("record", _plain(str(path) + (kept if path.exists() else ", not there yet")))
    shown = record or easel
    for name, value in (("easel", shown.easel), ("brush", shown.brush), ("camera", shown.camera)):
        table.add_row(name, _plain(value))
    table.add_row("canvas", str(shown.canvas))
    if shown.protrusion is not None:
        table.add_row("brush protrudes", f"{shown.protrusion * 1000:.1f} mm")
    for name, file in (("stroke library", shown.library), ("weights", shown.weights)):
        if file is not None:
            table.add_row(name, _plain(file.path))
    for name, lines in (
        ("robots", _robots()),
        ("cameras", _cameras()),
        ("stroke models", _stroke_models()),
        ("stroke families", _list_parts(registry.parts(registry.STROKE_FAMILIES), FamilyPart, lambda part: "")),
        ("goals", _goals()),
        ("replan policies", _policies()),
        *((name, _list_parts(registry.parts(group), object, lambda part: "")) for name, group in _WAYS.items()),
    ):
        for row, line in enumerate(lines):
            table.add_row(name if row == 0 else "", line)
    table.add_row("machine", f"Python {platform.python_version()}, torch {version('torch')}, {_device()}")
    existing = next(folder for folder in (path.absolute(), *path.absolute().parents) if folder.is_dir())
    table.add_row("free on its disk", f"{shutil.disk_usage(existing).free / 2**30:.1f} GB")
    return table


_WAYS = {
    "planners": registry.PLANNERS,
    "mixers": registry.MIXERS,
    "exporters": registry.EXPORTERS,
    "picture makers": registry.PICTURE_MAKERS,
}
"""Groups of parts that are told by their names alone."""


def _robots() -> Iterator[str]:
    """Yields each robot: its form after --robot, its title and missing packages."""
    for part in registry.parts(registry.EASELS).values():
        yield _describe(part, EaselKind, lambda kind: _part(kind.name, kind.title, kind.needed))
    for part in registry.parts(registry.ROBOTS).values():
        yield _describe(part, RobotKind, lambda kind: _part(kind.form, kind.title, kind.needed))


def _goals() -> Iterator[str]:
    """Yields the kinds of goals: our own in one line, then those of other packages with the package's name."""
    return _list_parts(registry.parts(registry.OBJECTIVES), GoalKind, lambda kind: _plain(kind.option))


def _policies() -> Iterator[str]:
    """Yields the names of replan policies: our own in one line, then those of other packages."""
    return _list_parts(registry.parts(registry.REPLAN_POLICIES), object, lambda policy: "")


def _list_parts(
    known: Mapping[str, registry.Part], kind: type[registry.Kind], tell: Callable[[registry.Kind], str]
) -> Iterator[str]:
    """Yields our own parts in one line, then each part of another package; a broken part with the reason."""
    yield ", ".join(_describe(part, kind, tell) or _plain(name) for name, part in known.items() if part.is_ours)
    for name, part in known.items():
        if not part.is_ours:
            yield f"{_describe(part, kind, tell) or _plain(name)} [dim]of {_plain(', '.join(part.packages))}[/]"


def _cameras() -> Iterator[str]:
    """Yields each camera: its form after --camera, its title and missing packages."""
    for part in registry.parts(registry.CAMERAS).values():
        yield _describe(part, CameraKind, lambda kind: _part(kind.form, kind.title, kind.needed))


def _stroke_models() -> Iterator[str]:
    """Yields our own stroke models in one line, then those of other packages."""

    def loaded(model: BrushModel) -> str:
        model.load()
        return _plain(model.name)

    return _list_parts(registry.parts(registry.STROKE_MODELS), BrushModel, loaded)


def _part(form: str, title: str, needed: Needed | None) -> str:
    lacks = "" if needed is None or not needed.lacking else f"; [yellow]needs {_plain(needed.command)}[/]"
    return f"{_plain(form)} [dim]{_plain(title)}[/]{lacks}"


def _describe(part: registry.Part, kind: type[registry.Kind], tell: Callable[[registry.Kind], str]) -> str:
    """Returns the description of a part; for a broken part, the reason."""
    try:
        return tell(part.load(kind))
    except WeightsError:
        return f"[red]{_plain(part.name)} is damaged, install anew[/]"
    except PluginError as broken:
        return f"[red]{_plain(str(broken))}[/]"


def _device() -> str:
    device = planning_device()
    return "no GPU (none is needed)" if device.type == "cpu" else f"plans on {torch.cuda.get_device_name(device)}"


def _plain(text: str) -> str:
    return text.replace("[", r"\[")
