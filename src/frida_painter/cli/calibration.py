"""What `calibrate` does: procedures are led at an easel, and what they find is entered into its record."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from rich.console import Console

from frida_painter import images
from frida_painter.cli.terminal import Terminal
from frida_painter.runs.calibrating import CalibrationSetup, begin_procedure, learn_from, record_to_renew
from frida_painter.runs.spec import RunSpec
from frida_painter.session.procedures.calibration_status import require_basis
from frida_painter.session.procedures.dialogue import Answer, Finding, Question, lead
from frida_painter.session.procedures.strokes import StrokesFinding


def lead_all(names: Sequence[str], setup: "CalibrationSetup", *, anew: bool, ask: bool) -> None:
    """Does the procedures of these names, and enters each into the record as soon as it is done.

    anew: all that was known is done again; ask: a person answers, else the virtual studio agrees to what is proposed.
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
    """The easel that the options name. Raises ConfigError."""
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
    """The virtual studio agrees to whatever is proposed."""
    return question.proposal  # type: ignore[return-value]  # None where nothing was found: the procedure says what to do


class _Silence:
    """Stands where a status line would be overwritten by a dialogue."""

    def __enter__(self) -> "_Silence":
        return self

    def __exit__(self, *_: object) -> None:
        pass

    def update(self, text: str) -> None:
        """Says nothing."""
