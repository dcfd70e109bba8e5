"""Printed markers in photographs of the virtual studio, which prints, cuts and lays the page with its own errors."""

import re
from dataclasses import replace
from functools import cache

import cv2
import numpy as np
import pytest

from frida_painter.canvas_size import CanvasSize
from frida_painter.easel.dialogue import lead
from frida_painter.errors import CalibrationError, ConfigError
from frida_painter.hardware.faults import PlacementError
from frida_painter.perception.landmarks import find_canvas
from frida_painter.perception.markers import find_camera_motion
from frida_painter.perception.snapshot import find_corners
from frida_painter.session.observer import CanvasObserver
from frida_painter.virtual.camera import CameraSpec
from frida_painter.virtual.printed import Printer
from frida_painter.virtual.studio import StudioSettings, VirtualStudio, open_studio
from frida_painter_calibration.marker_sheet import DOTS, draw_marker_sheet
from frida_painter_calibration.procedures.canvas import canvas
from support.printed_sheet import cards, lay_sheet

SIZE = CanvasSize(0.24, 0.18)
USUAL = Printer.sample(1)


def opened(size: CanvasSize = SIZE, **camera) -> VirtualStudio:
    spec = CameraSpec(photograph=(900, 1200), filling=0.7, **camera)
    studio = open_studio(size, seed=1, settings=StudioSettings(cell=0.5, camera=spec))
    studio.easel.robot.connect()
    studio.easel.camera.connect()
    return studio


def photograph(studio: VirtualStudio) -> np.ndarray:
    return studio.camera.capture(-1.0).image


@cache
def usual() -> np.ndarray:
    studio = opened()
    lay_sheet(studio, USUAL)
    return photograph(studio)


def off(corners, studio: VirtualStudio) -> float:
    """Millimetres."""
    truth = np.array(studio.camera.corners)
    pixels = np.linalg.norm(truth[1] - truth[0]) / (1000 * studio.easel.canvas.width)
    return float(np.linalg.norm(np.array(corners) - truth, axis=1).max() / pixels)


def test_one_photograph_tells_corners_lens_light_and_colours_and_asks_nothing() -> None:
    studio = opened()
    lay_sheet(studio, USUAL)

    def nobody(question):
        raise AssertionError(question.text)

    record = lead(canvas(studio.easel), nobody).enter(studio.easel.calibration)
    assert off(record.corners, studio) < 0.3 and record.lens is not None and record.bare is not None
    assert list(record.done) == ["canvas", "color"] and len(record.markers) == 6


@pytest.mark.parametrize("turns", [1, 2, 3])
def test_the_top_left_corner_is_known_from_any_side_of_the_table(turns: int) -> None:
    studio, seen = opened(), usual()
    rows, columns = seen.shape[:2]
    truth = np.array(studio.camera.corners)
    for _ in range(turns):
        truth = np.c_[truth[:, 1], columns - 1 - truth[:, 0]]
        rows, columns = columns, rows
    found = np.array(find_corners(np.ascontiguousarray(np.rot90(seen, turns)), SIZE))
    assert np.linalg.norm(found - truth, axis=1).max() < 1.5


def test_a_covered_piece_is_missed_by_nobody_and_two_are() -> None:
    studio = opened()
    pieces, _ = cards(SIZE, USUAL)
    studio.table.under = tuple(pieces[:3])
    outline = find_canvas(photograph(studio), SIZE)
    assert off(outline.corners, studio) < 0.3 and outline.marked.missing == ("piece 4 (bottom left)",)
    studio.table.under = tuple(pieces[:2])
    with pytest.raises(CalibrationError, match=r"piece 3 .*piece 4 .*three must be"):
        find_canvas(photograph(studio), SIZE)


def test_a_mirrored_photograph_a_small_print_another_canvas_and_two_sheets_are_refused() -> None:
    with pytest.raises(CalibrationError, match="mirrored"):
        find_canvas(np.ascontiguousarray(usual()[:, ::-1]), SIZE)
    studio = opened()
    lay_sheet(studio, replace(USUAL, scale=0.97))
    with pytest.raises(CalibrationError, match="if it is 97 mm long"):
        find_canvas(photograph(studio), SIZE)
    with pytest.raises(CalibrationError, match=r"a canvas of 24. x 1[78]. mm, and the canvas was said to be 240 x 150"):
        find_canvas(usual(), CanvasSize(0.24, 0.15))
    pieces, _ = cards(SIZE, USUAL)
    again = replace(pieces[0], center=(120.0, 90.0))
    studio.table.under, studio.table.over = tuple(pieces), (again,)
    with pytest.raises(CalibrationError, match=r"piece 1 .* twice"):
        find_canvas(photograph(studio), SIZE)


def test_a_piece_that_was_turned_is_named() -> None:
    studio = opened()
    pieces, _ = cards(SIZE, USUAL)
    pieces[2] = replace(pieces[2], turn=pieces[2].turn + 0.4)
    studio.table.under = tuple(pieces)
    with pytest.raises(CalibrationError, match="piece 3"):
        find_canvas(photograph(studio), SIZE)


def test_a_moved_camera_is_told_from_a_canvas_that_was_moved() -> None:
    studio = opened()
    lay_sheet(studio, USUAL, card=False)
    record = lead(canvas(studio.easel), lambda question: question.proposal).enter(studio.easel.calibration)
    still = find_camera_motion(photograph(studio), record)
    assert still.far < 0.0001 and still.moved == ()
    looking = CanvasObserver(replace(studio.easel, calibration=record))
    before = looking.photograph(-1.0).image.astype(float)
    assert not looking.moved
    studio.camera.push(4.0, 3.0)
    after = looking.photograph(-1.0).image.astype(float)
    shifted = photograph(studio).astype(float)
    assert "camera" in looking.moved[0] and np.abs(after - before).mean() < np.abs(shifted - before).mean() / 2
    studio.camera.push(-3.6, -2.7)
    assert find_camera_motion(photograph(studio), record).far == pytest.approx(0.0005, abs=0.0001)
    studio.camera.push(-0.4, -0.3)
    looking.photograph(-1.0)
    assert not looking.moved, "it stands where it was"
    looking.examine(-1.0, 270)
    studio.table.knock = PlacementError((0.0004, 0.0003), 0.0)
    looking.examine(-1.0, 270)
    (told,) = looking.moved
    assert re.search(r"canvas was moved under the camera by 0\.[456] mm \(0\.[34] mm right, 0\.[23] mm up", told)
    studio.table.knock = PlacementError((0.0, 0.0), 0.0)
    looking.examine(-1.0, 270)
    assert not looking.moved
    assert find_camera_motion(np.zeros_like(usual()), record) is None


@pytest.mark.parametrize("size", ["A6", "A3 landscape", "1x0.7m", "2x1.5m"])
def test_markers_have_their_true_size_on_the_page(size: str) -> None:
    page = draw_marker_sheet(CanvasSize.parse(size), CanvasSize.parse("A4")).image
    assert page.size == tuple(round(inches * DOTS) for inches in (210 / 25.4, 297 / 25.4))
    black = (np.array(page.convert("L")) < 10).astype(np.uint8)
    _, _, facts, _ = cv2.connectedComponentsWithStats(black)
    sides = sorted(fact[2] * 25.4 / DOTS for fact in facts[1:] if fact[2] > 15 / 25.4 * DOTS and fact[2] == fact[3])
    wanted = {"A6": 20, "A3 landscape": 25, "1x0.7m": 40, "2x1.5m": 50}[size]
    assert len(sides) == 6 and sides[-4:] == pytest.approx([wanted] * 4, abs=0.1)
    with pytest.raises(ConfigError, match="too small"):
        draw_marker_sheet(CanvasSize.parse(size), CanvasSize.parse("A6"))
