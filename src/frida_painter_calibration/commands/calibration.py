"""Work of `calibrate`: procedures at an easel, which renew its record."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from torch import Tensor

from frida_painter import images
from frida_painter.calibration import Corners
from frida_painter.canvas_size import CanvasSize
from frida_painter.cli.terminal import terminal_at
from frida_painter.easel.connecting import connect_easel
from frida_painter.easel.dialogue import Answer, Finding, PointCorners, Question, lead
from frida_painter.errors import CalibrationError, ConfigError
from frida_painter.hardware.easel import Easel
from frida_painter.perception.snapshot import find_corners
from frida_painter.runs.spec import RunSpec
from frida_painter.session.opening import require_basis
from frida_painter_calibration.calibrating import CalibrationSetup, begin_procedure, learn_from, record_to_renew
from frida_painter_calibration.procedures.strokes import StrokesFinding
from frida_painter_calibration.procedures.surface import read_surface
from frida_painter_calibration.procedures.surface_marks import learn_surface, look_at_marks, paint_marks, read_marks


def lead_all(names: Sequence[str], setup: "CalibrationSetup", *, anew: bool, ask: bool) -> None:
    """Runs these procedures, and enters each result into the record at once.

    anew: True if all procedures are done again.
    ask: True if a person answers; otherwise the virtual studio accepts every proposal.
    """
    here, path = setup.easel, setup.record
    known = record_to_renew(path, here.calibration, anew=anew)
    console = Console(stderr=True, highlight=False)
    terminal = terminal_at(path.parent, console)
    answer = terminal.answer if ask else _proposal
    try:
        here = connect_easel(here, answer if ask else None, terminal.tell)
        for name in names:
            require_basis(name, known, here.calibration, defaults_hold=here.simulated or not here.has_camera)
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


def enter_heights(heights: Path, setup: "CalibrationSetup", procedure: str) -> None:
    """Enters a height map from a file into the record. Raises CalibrationError, ConfigError, StorageError."""
    if procedure != "surface":
        raise ConfigError("--heights is for calibrate surface; leave it out.")
    known = record_to_renew(setup.record, setup.easel.calibration, anew=False)
    finding = read_surface(heights, replace(setup.easel, calibration=known))
    finding.enter(known).save(setup.record)
    _tell(procedure, finding, setup)
    print(f"The record: {setup.record}")


def learn_from_marks(setup: "CalibrationSetup", procedure: str, picture: Path | None, *, ask: bool) -> None:
    """Paints marks and learns the height map from a picture of them; without a camera a person gives the picture later.

    picture: file with a person's picture of marks that were painted before; None to paint them now
    ask: True if a person answers
    Raises ConfigError if it is not for the surface procedure, CalibrationError and FrameRejected if the picture tells
    no map, RobotError, CameraError, ImageError, StorageError.
    """
    if procedure != "surface":
        raise ConfigError("--marks and --picture are for calibrate surface; leave them out.")
    known = record_to_renew(setup.record, setup.easel.calibration, anew=False)
    here = replace(setup.easel, calibration=known.with_surface(None))
    terminal = terminal_at(setup.record.parent)
    answer = terminal.answer if ask else _proposal
    if picture is None:
        seen = _paint_marks(here, setup, answer, terminal.tell, ask=ask)
        if seen is None:
            print(
                "The marks are painted. Take a picture of the whole canvas, also from aside, and give it with the same "
                "command and --picture FILE."
            )
            return
    else:
        photograph = images.to_uint8(images.load(picture))
        corners = point_corners(photograph, here.canvas, answer if ask else None)
        seen = read_marks(photograph, corners, here, setup.brush, points=setup.points)
    finding = learn_surface(seen, here, setup.brush, points=setup.points)
    finding.enter(known).save(setup.record)
    _tell(procedure, finding, setup)
    print(f"The record: {setup.record}")


def _paint_marks(
    easel: Easel,
    setup: "CalibrationSetup",
    answer: Callable[[Question], Answer],
    tell: Callable[[str], None],
    *,
    ask: bool,
) -> Tensor | None:
    """Paints the marks; returns the canvas in the camera's photograph, None if there is no camera."""
    try:
        here = connect_easel(easel, answer if ask else None, tell)
        lead(paint_marks(here, setup.brush, points=setup.points), answer)
        return look_at_marks(here) if here.has_camera else None
    finally:
        easel.camera.close()
        easel.robot.close()


def point_corners(
    photograph: NDArray[np.uint8],
    canvas: CanvasSize,
    answer: Callable[[Question], Answer] | None,
    known: Corners | None = None,
) -> Corners:
    """Returns the corners of the canvas in a person's picture [H, W, 3], clockwise from any of them.

    answer: asks the person to confirm or to point at them; None if nobody is there
    known: corners that the person gave
    Raises CalibrationError if nobody is there and none are found.
    """
    found: Corners | None = known
    try:
        found = known or find_corners(photograph, canvas)
    except CalibrationError:
        if answer is None:
            raise
    if answer is None:
        assert found is not None
        return found
    told = "Where are the canvas's corners, clockwise from any of them?"
    if found is not None:
        told = "Are these the canvas's corners, clockwise from any of them? (The green lines join them.)"
    corners = answer(PointCorners(told, _mark_corners(photograph, found), found))
    assert isinstance(corners, tuple)
    return corners


def _mark_corners(photograph: NDArray[np.uint8], corners: Corners | None) -> Tensor:
    """Returns the picture [3, h, w] with lines between the corners that were found."""
    drawn = photograph.copy()
    if corners is not None:
        around = np.array(corners).round().astype(np.int32)
        cv2.polylines(drawn, [around], isClosed=True, color=(0, 200, 80), thickness=max(2, drawn.shape[1] // 400))
    return images.from_uint8(drawn)


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
    said: dict[str, Any] = {name: value for name, value in given.items() if value is not None}
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
