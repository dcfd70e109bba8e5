"""Work of `doctor`: what a robot's controller tells, the state of a calibration record, and the parts there are."""

import platform
import shutil
from collections.abc import Callable, Iterator
from dataclasses import replace
from importlib.metadata import version
from pathlib import Path
from typing import Any

import torch
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from frida_painter import registry
from frida_painter.brush.kinds import BrushModel, FamilyPart
from frida_painter.calibration import Calibration, previous
from frida_painter.canvas_size import CanvasSize
from frida_painter.easel.connecting import examine_robot
from frida_painter.easel.kinds import EaselKind
from frida_painter.errors import CalibrationError, PluginError, WeightsError
from frida_painter.hardware.kinds import CameraKind, RobotKind
from frida_painter.hardware.workcell import WorkcellConfig
from frida_painter.objectives.objective import GoalKind
from frida_painter.session.opening import OLD, ProcedureStatus, adopt_camera, planning_device, require, statuses
from frida_painter.session.rehearsal import FlatbedWorkspace

_SHOWN = {"fact": "  ", "warning": "[yellow]! [/]", "refusal": "[bold red]x [/]"}


def examine_machine(robot: str, workspace: Path | None) -> bool:
    """Prints what the controller of a named robot tells; nothing moves. Returns False if it cannot paint like this.

    workspace: file of the workspace, to compare its speeds; None if there is none yet

    Raises ConfigError if the name or the file is wrong, RobotBusy if a painting uses the robot, RobotError if nobody
    answers.
    """
    console = Console(highlight=False, soft_wrap=True)
    if workspace is None:  # a driver needs one even if it is only asked questions
        place = FlatbedWorkspace().motion(CanvasSize(0.3, 0.2)).workspace
        place = replace(place, home=(0.0, 0.0, place.upper[2]))
    else:
        place = WorkcellConfig.load(workspace).workspace
    found = examine_robot(robot, place, compare=workspace is not None)
    if found is None:
        console.print(f"{escape(robot)}: its driver has no examination; connect it to see what it says.")
        return True
    console.print(f"[bold]{escape(robot)}[/]")
    for fact in found.facts:
        console.print(f"{_SHOWN[fact.weight]}{escape(fact.text)}")
    fit = all(fact.weight != "refusal" for fact in found.facts)
    console.print("[green]It can paint.[/]" if fit else "[bold red]It cannot paint like this.[/]")
    return fit


# Output of doctor: the state of a calibration record, procedure by procedure, and the parts on this machine.


def examine(path: Path, easel: Calibration, *, named: bool) -> bool:
    """Prints the state of the record at `path` for an easel whose default record is `easel`.

    named: True if a person asked for this file.
    Returns True if painting with the record is possible.
    """
    console = Console(highlight=False, soft_wrap=True)
    record, trouble = None, ""
    if named or path.exists():
        try:
            record = adopt_camera(Calibration.load(path), easel)
            require(record, easel, ())
        except CalibrationError as reason:
            trouble = str(reason)
    if record is not None and not trouble:
        table = Table("procedure", "done", "left over", "state", box=None, padding=(0, 2, 0, 0))
        for status in statuses(record, easel):
            table.add_row(*_describe_procedure(status))
        console.print(table)
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


def _describe_procedure(status: ProcedureStatus) -> tuple[str, str, str, str]:
    """Returns the procedure, its day, what it left over, and its state."""
    done, state = status.done, "[green]good[/]"
    if status.fault:
        state = f"[red]to be repeated[/]: {_plain(status.fault)}"
    elif done is None:
        state = "[dim]never done, the easel's default holds[/]"
    elif status.is_old:
        state = f"[yellow]good, but {status.days} days old[/] (repeat it after {OLD})"
    if done is None:
        return status.procedure, "-", "-", state
    left = {
        "canvas": f"{done.residual:.2f} px",
        "robot": f"{done.residual * 1000:.2f} mm",
        "color": f"{done.residual:.1f} CIEDE2000",
        "brush": f"{done.residual * 1000:.2f} mm",
        "strokes": f"{done.residual:.4f} of the map",
    }
    return status.procedure, done.dated[:10], left[status.procedure], state


def _about(path: Path, easel: Calibration, record: Calibration | None) -> Table:
    """Returns a table of the ids, the files, the parts and the machine."""
    shown, there = record or easel, path.exists()
    kept = f" (the one before: {previous(path).name})" if previous(path).exists() else ""
    device = planning_device()
    plans = "no GPU (none is needed)" if device.type == "cpu" else f"plans on {torch.cuda.get_device_name(device)}"
    existing = next(folder for folder in (path.absolute(), *path.absolute().parents) if folder.is_dir())
    rows: list[tuple[str, list[str]]] = [
        ("record", [_plain(str(path) + (kept if there else ", not there yet"))]),
        ("easel", [_plain(shown.easel)]),
        ("brush", [_plain(shown.brush)]),
        ("camera", [_plain(shown.camera)]),
        ("canvas", [str(shown.canvas)]),
        ("brush protrudes", [] if shown.protrusion is None else [f"{shown.protrusion * 1000:.1f} mm"]),
        ("stroke library", [] if shown.library is None else [_plain(shown.library.path)]),
        ("weights", [] if shown.weights is None else [_plain(shown.weights.path)]),
        ("robots", [*_one_by_one(registry.EASELS, EaselKind), *_one_by_one(registry.ROBOTS, RobotKind)]),
        ("cameras", [*_one_by_one(registry.CAMERAS, CameraKind)]),
        ("stroke models", [*_together(registry.STROKE_MODELS, BrushModel, _tell_loaded)]),
        ("stroke families", [*_together(registry.STROKE_FAMILIES, FamilyPart)]),
        ("goals", [*_together(registry.OBJECTIVES, GoalKind, lambda kind: _plain(kind.option))]),
        ("replan policies", [*_together(registry.REPLAN_POLICIES)]),
        ("planners", [*_together(registry.PLANNERS)]),
        ("mixers", [*_together(registry.MIXERS)]),
        ("exporters", [*_together(registry.EXPORTERS)]),
        ("picture makers", [*_together(registry.PICTURE_MAKERS)]),
        ("machine", [f"Python {platform.python_version()}, torch {version('torch')}, {plans}"]),
        ("free on its disk", [f"{shutil.disk_usage(existing).free / 2**30:.1f} GB"]),
    ]
    table = Table(box=None, show_header=False, padding=(0, 2, 0, 0))
    for name, lines in rows:
        for row, line in enumerate(lines):
            table.add_row(name if row == 0 else "", line)
    return table


def _one_by_one(group: str, kind: type[Any]) -> Iterator[str]:
    """Yields a line for each part of a group: its form in an option, its title and missing packages."""

    def tell(part: Any) -> str:
        form = part.name if kind is EaselKind else part.form
        needed = part.needed
        lacks = "" if needed is None or not needed.lacking else f"; [yellow]{_plain(needed.advice('it'))}[/]"
        return f"{_plain(form)} [dim]{_plain(part.title)}[/]{lacks}"

    return (_describe(part, kind, tell) for part in registry.parts(group).values())


def _together(group: str, kind: type[Any] = object, tell: Callable[[Any], str] = lambda part: "") -> Iterator[str]:
    """Yields our own parts of a group in one line, then each part of another package.

    tell: returns how a loaded part is told; "" for its name. A broken part is told by its reason.
    """
    known = registry.parts(group)
    yield ", ".join(_describe(part, kind, tell) or _plain(name) for name, part in known.items() if part.is_ours)
    for name, part in known.items():
        if not part.is_ours:
            yield f"{_describe(part, kind, tell) or _plain(name)} [dim]of {_plain(', '.join(part.packages))}[/]"


def _tell_loaded(model: BrushModel) -> str:
    model.load()
    return _plain(model.name)


def _describe(part: registry.Part, kind: type[Any], tell: Callable[[Any], str]) -> str:
    """Returns the description of a part; for a broken part, the reason."""
    try:
        return tell(part.load(kind))
    except WeightsError:
        return f"[red]{_plain(part.name)} is damaged, install anew[/]"
    except PluginError as broken:
        return f"[red]{_plain(str(broken))}[/]"


def _plain(text: str) -> str:
    return text.replace("[", r"\[")
