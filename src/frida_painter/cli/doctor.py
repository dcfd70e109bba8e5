"""What doctor prints: how a calibration record stands, procedure by procedure, and what this machine has."""

import platform
import shutil
from importlib.metadata import version
from pathlib import Path

import torch
from rich.console import Console
from rich.table import Table

from frida_painter.brush.kinds import KINDS
from frida_painter.brush.weights import load_stroke_model
from frida_painter.calibration import Calibration, previous
from frida_painter.errors import CalibrationError, WeightsError
from frida_painter.session.opening import planning_device
from frida_painter.session.procedures.calibration_status import OLD, CalibrationStatus, require, statuses


def examine(path: Path, easel: Calibration, *, named: bool) -> bool:
    """Prints how the record at `path` stands at an easel whose default record is `easel`.

    named: whether a person asked for this very file. Returns whether painting would go ahead.
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
    """The record, None where there is none, and why it would be refused, "" where it would not."""
    if not path.exists() and not named:
        return None, ""
    record = None
    try:
        record = Calibration.load(path)
        require(record, easel, ())
    except CalibrationError as reason:
        return record, str(reason)
    return record, ""


def _procedures(record: Calibration, easel: Calibration) -> Table:
    table = Table("procedure", "done", "left over", "state", box=None, padding=(0, 2, 0, 0))
    for standing in statuses(record, easel):
        table.add_row(
            standing.procedure,
            standing.done.dated[:10] if standing.done else "-",
            _residual(standing),
            _state(standing),
        )
    return table


def _residual(standing: CalibrationStatus) -> str:
    if standing.done is None:
        return "-"
    residual = standing.done.residual
    return {
        "canvas": f"{residual:.2f} px",
        "robot": f"{residual * 1000:.2f} mm",
        "color": f"{residual:.1f} CIEDE2000",
        "brush": f"{residual * 1000:.2f} mm",
        "strokes": f"{residual:.4f} of the map",
    }[standing.procedure]


def _state(standing: CalibrationStatus) -> str:
    if standing.fault:
        return f"[red]to be repeated[/]: {_plain(standing.fault)}"
    if standing.done is None:
        return "[dim]never done, the easel's default holds[/]"
    if standing.is_old:
        return f"[yellow]good, but {standing.days} days old[/] (repeat it after {OLD})"
    return "[green]good[/]"


def _about(path: Path, easel: Calibration, record: Calibration | None) -> Table:
    """The ids, the files, the machine."""
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
    table.add_row("stroke models", ", ".join(map(_stroke_model, (kind.name for kind in KINDS))))
    table.add_row("machine", f"Python {platform.python_version()}, torch {version('torch')}, {_device()}")
    existing = next(folder for folder in (path.absolute(), *path.absolute().parents) if folder.is_dir())
    table.add_row("free on its disk", f"{shutil.disk_usage(existing).free / 2**30:.1f} GB")
    return table


def _stroke_model(brush: str) -> str:
    try:
        load_stroke_model(brush)
    except WeightsError:
        return f"[red]{brush} is damaged, install anew[/]"
    return brush


def _device() -> str:
    device = planning_device()
    return "no GPU (none is needed)" if device.type == "cpu" else f"plans on {torch.cuda.get_device_name(device)}"


def _plain(text: str) -> str:
    return text.replace("[", r"\[")
