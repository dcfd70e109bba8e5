"""Work of `calibrate` and `doctor`: leads procedures at an easel, saves their results, and shows a record's state."""

import platform
import shutil
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from importlib.metadata import version
from pathlib import Path

import torch
from rich.console import Console
from rich.table import Table

from frida_painter import images, registry
from frida_painter.brush.kinds import BrushModel
from frida_painter.calibration import Calibration, previous
from frida_painter.cli.terminal import Terminal
from frida_painter.easel.dialogue import Answer, Finding, Question, lead
from frida_painter.easel.kinds import EaselKind
from frida_painter.errors import CalibrationError, PluginError, WeightsError
from frida_painter.hardware.kinds import CameraKind, Needed, RobotKind
from frida_painter.objectives.objective import GoalKind
from frida_painter.procedures.strokes import StrokesFinding
from frida_painter.runs.painting_easel import CalibrationSetup, begin_procedure, learn_from, record_to_renew
from frida_painter.runs.spec import RunSpec
from frida_painter.session.opening import OLD, ProcedureStatus, planning_device, require, require_basis, statuses


def lead_all(names: Sequence[str], setup: "CalibrationSetup", *, anew: bool, ask: bool) -> None:
    """Runs these procedures, and enters each result into the record at once.

    anew: True if all procedures are done again.
    ask: True if a person answers; otherwise the virtual studio accepts every proposal.
    """
    here, path = setup.easel, setup.record
    known = record_to_renew(path, here.calibration, anew=anew)
    console = Console(stderr=True, highlight=False)
    terminal = Terminal(
        lambda prompt: console.input(prompt, markup=False), lambda line: console.print(line, markup=False), path.parent
    )
    answer = terminal.answer if ask else _proposal
    try:
        here.robot.connect()
        here.camera.connect()
        for name in names:
            require_basis(name, known, here.calibration, defaults_hold=here.simulated)
            with console.status(f"{name} ...") if not ask else _Silence() as status:
                current = replace(setup, easel=replace(here, calibration=known), say=status.update)
                finding = lead(begin_procedure(name, current), answer)
                known = finding.enter(known)
                if isinstance(finding, StrokesFinding):
                    known = learn_from(finding, current, known)
            known.save(path)
            _tell(name, finding, setup)
    finally:
        here.camera.close()
        here.robot.close()
    print(f"The record: {path}")


def easel_spec(
    robot: str,
    camera: str,
    workspace: Path | None,
    canvas: str | None,
    brush: str,
    seed: int,
    placement_error: str | None,
) -> RunSpec:
    """Returns the description of the easel that the options name. Raises ConfigError."""
    given = {"canvas": canvas, "workspace": workspace, "placement_error": placement_error}
    said = {name: value for name, value in given.items() if value is not None}
    return RunSpec.of(robot=robot, camera=camera, brush=brush, seed=seed, **said)


def _tell(name: str, finding: Finding, setup: CalibrationSetup) -> None:
    print(f"{name}: {finding.sentence}")
    if finding.picture is not None:
        picture = setup.beside(name, "png")
        images.save(finding.picture, picture)
        print(f"  {picture}")


def _proposal(question: Question) -> Answer:
    """Returns the proposal, as the answer of the virtual studio."""
    return question.proposal  # type: ignore[return-value]  # None if nothing was found: the procedure says what to do


class _Silence:
    """Replacement for a status line, which a dialogue would overwrite."""

    def __enter__(self) -> "_Silence":
        return self

    def __exit__(self, *_: object) -> None:
        pass

    def update(self, text: str) -> None:
        """Does nothing."""


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
        record = Calibration.load(path)
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
        ("goals", _goals()),
        ("replan policies", _policies()),
    ):
        for row, line in enumerate(lines):
            table.add_row(name if row == 0 else "", line)
    table.add_row("machine", f"Python {platform.python_version()}, torch {version('torch')}, {_device()}")
    existing = next(folder for folder in (path.absolute(), *path.absolute().parents) if folder.is_dir())
    table.add_row("free on its disk", f"{shutil.disk_usage(existing).free / 2**30:.1f} GB")
    return table


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
    lacks = "" if needed is None or not needed.lacking else f"; [yellow]needs {_plain(needed.install)}[/]"
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
