from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from easels import CALIBRATION
from frida_painter.brush.dip import Dip
from frida_painter.brush.library import StrokeLibrary
from frida_painter.calibration import Calibration, LearnedFile
from frida_painter.errors import LibraryError
from frida_painter.session.refilling import STROKES_PER_DIP, refilled
from marks import SMALL, small_library


def record_of(library: StrokeLibrary, folder: Path) -> Calibration:
    """A record with that stroke library."""
    library.save(folder / "strokes.npz")
    return replace(CALIBRATION, library=LearnedFile(str(folder / "strokes.npz"), "0" * 64))


def test_a_library_with_fewer_dips_than_strokes_tells_what_a_dip_paints(tmp_path: Path) -> None:
    library = small_library(40)
    since = np.where(np.arange(40) % 2 == 0, 0, 1e-4).astype(np.float32)
    known = record_of(replace(library, since_dip=since, flaws=np.zeros(40, np.uint8)), tmp_path)
    for simulated in (False, True):
        dip = refilled(SMALL, known, simulated=simulated).dip
        assert 1e-4 < dip.holds < 4e-4 and not dip.by_strokes
    other = replace(SMALL, name="other")
    assert refilled(other, known, simulated=False).dip == Dip.of_strokes(STROKES_PER_DIP), "it is of another brush"


def test_where_nothing_shows_it_strokes_are_counted_but_the_projects_own_brushes_are_known(tmp_path: Path) -> None:
    for record in (CALIBRATION, record_of(small_library(4), tmp_path)):
        assert refilled(SMALL, record, simulated=False).dip == Dip.of_strokes(4)
        assert refilled(SMALL, record, simulated=True) is SMALL


def test_a_damaged_library_is_told(tmp_path: Path) -> None:
    record = record_of(small_library(4), tmp_path)
    (tmp_path / "strokes.npz").write_bytes(b"PK")
    with pytest.raises(LibraryError, match=r"strokes\.npz"):
        refilled(SMALL, record, simulated=False)
