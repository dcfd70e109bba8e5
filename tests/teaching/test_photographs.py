"""Strokes cut out of photographs of sheets: a sheet of known marks, seen from a side under uneven light."""

from functools import cache
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch
from numpy.typing import NDArray

import frida_painter as fp
from frida_painter.errors import CalibrationError, LibraryError
from frida_painter.system import images

SHEET = "14x10cm"
HEAD = "start_x_mm,start_y_mm,angle_deg,length_mm,bend_mm,thickness"
ROWS = [(20, 25, 0, 40, 5, 0.8), (20, 60, 0, 30, -6, 0.4), (80, 30, 30, 35, 0, 0.6), (110, 85, 180, 40, 4, 1.0)]


def strokes() -> fp.Strokes:
    x, y, angle, length, bend, thickness = np.array(ROWS, float).T
    black = np.full(len(x), 0.05)
    return fp.Strokes.from_array(
        np.stack((x / 1e3, y / 1e3, np.radians(angle), length / 1e3, bend / 1e3, thickness, *[black] * 3), 1)
    )


@cache
def photograph(*, turned: bool = False) -> NDArray[np.uint8]:
    """The sheet on a dark table, askew, in light that falls off to the right."""
    sheet = images.to_uint8(fp.render_batch("fine", strokes(), SHEET, rows=600).picture)
    rows, columns = sheet.shape[:2]
    corners = np.array([[90, 80], [990, 50], [1020, 720], [60, 700]], np.float32)
    corners = np.roll(corners, 2, 0) if turned else corners
    whole = np.array([[0, 0], [columns, 0], [columns, rows], [0, rows]], np.float32)
    view = cv2.getPerspectiveTransform(whole, corners)
    seen = np.full((780, 1100, 3), (60, 50, 45), np.uint8)
    cv2.warpPerspective(sheet, view, (1100, 780), dst=seen, borderMode=cv2.BORDER_TRANSPARENT, flags=cv2.INTER_AREA)
    light = np.linspace(0.95, 0.7, 1100)[None, :, None] * np.array([1.0, 0.97, 0.9])
    return np.clip(np.rint(seen * light), 0, 255).astype(np.uint8)


@pytest.fixture(scope="module")
def table(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("sheets") / "strokes.csv"
    path.write_text("\n".join((HEAD, *(",".join(map(str, row)) for row in ROWS))) + "\n")
    return path


@pytest.mark.parametrize("turned", [False, True])
def test_marks_are_those_of_the_sheet(table: Path, turned: bool) -> None:
    library = fp.StrokeLibrary.from_photographs([photograph(turned=turned)], table, sheet=SHEET)
    model = fp.load_stroke_model("fine")
    cut, true = library.maps(model.frame), model(*library.shapes()).detach()
    assert len(library) == len(ROWS) and library.length_m.tolist() == pytest.approx([0.04, 0.03, 0.035, 0.04])
    assert float((cut - true).abs().mean()) < 0.02  # a mark covers some 0.1 of its frame
    for one, other in zip(cut, true, strict=True):
        assert float(torch.corrcoef(torch.stack((one.flatten(), other.flatten())))[0, 1]) > 0.93


def test_sheets_are_named_by_their_files(tmp_path: Path, table: Path) -> None:
    head, *rows = table.read_text().splitlines()
    for name in ("a.png", "b.png"):
        fp.save_picture(photograph(), tmp_path / name)
    (tmp_path / "strokes.csv").write_text(
        "\n".join((f"{head},sheet", *(f"{row},{name}" for row in rows for name in ("a.png", "2")))) + "\n"
    )
    library = fp.StrokeLibrary.from_photographs(f"{tmp_path}/*.png", tmp_path / "strokes.csv", sheet=SHEET)
    assert len(library) == 2 * len(rows)
    library.save(tmp_path / "library.npz")
    assert len(fp.StrokeLibrary.load(tmp_path / "library.npz")) == 2 * len(rows)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("a,b\n1,2\n", "has no column start_x_mm"),
        (f"{HEAD}\n", "names no stroke"),
        (f"{HEAD}\n1,2,3,4,5,6\n", r"thickness '6' in line 2; it is a number from 0 to 1"),
        (f"{HEAD}\nx,2,3,4,5,0.6\n", "start_x_mm 'x' in line 2"),
        (f"{HEAD}\nnan,2,3,4,5,0.6\n", "start_x_mm 'nan'"),
        (f"{HEAD}\n130,50,0,40,0,0.5\n", "Stroke 1 of photograph 1 leaves its sheet"),
        (f"{HEAD},sheet\n20,50,0,40,0,0.5,3\n", "sheet '3' in line 2"),
        (f"{HEAD}\n20,90,0,10,0,0.5\n", "shows no paint where its strokes should be"),
    ],
)
def test_a_wrong_table_is_refused_with_its_line(tmp_path: Path, text: str, says: str) -> None:
    (tmp_path / "t.csv").write_text(text)
    with pytest.raises(LibraryError, match=says):
        fp.StrokeLibrary.from_photographs([photograph()], tmp_path / "t.csv", sheet=SHEET)


def test_a_photograph_without_a_sheet_is_refused(table: Path) -> None:
    with pytest.raises(CalibrationError, match="photograph 1: The sheet of 140 x 100 mm cannot be told"):
        fp.StrokeLibrary.from_photographs([np.full((300, 400, 3), 90, np.uint8)], table, sheet=SHEET)
    with pytest.raises(LibraryError, match="No file is called"):
        fp.StrokeLibrary.from_photographs("no/*.jpg", table)
    with pytest.raises(LibraryError, match="No photograph was given"):
        fp.StrokeLibrary.from_photographs([], table)
