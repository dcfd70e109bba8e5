from dataclasses import replace

import numpy as np
import pytest

from frida_painter.brush.library import StrokeLibrary
from frida_painter.system import images
from marks import small_library

TRUE_PHOTOGRAPHS = True


def test_a_library_is_painted_with_its_contact_sheet(call, tmp_path):
    status, said, _ = call("strokes", "paint", "--brush", "fine", "--count", 2, "--out", "mine.npz")
    assert status == 0 and "2 strokes of brush fine" in said and "mine.png" in said
    assert StrokeLibrary.load(tmp_path / "mine.npz").flaws.tolist() == [0, 0]
    assert images.load(tmp_path / "mine.png").shape[2] == 1800
    assert sorted(path.name for path in tmp_path.iterdir()) == ["mine.npz", "mine.png"]


def test_a_library_of_whatever_origin_is_inspected(call, tmp_path):
    library = small_library(30)
    magnitude = library.magnitude.copy()
    magnitude[7] = 0
    replace(library, magnitude=magnitude).save(tmp_path / "theirs.npz")
    status, said, _ = call("strokes", "inspect", "theirs.npz", "--out", "sheet.png")
    assert status == 0 and "30 strokes, 1 of them dirty" in said and "nearly empty" in said and said.count(": 7") == 1
    assert (images.load(tmp_path / "sheet.png")[0] - images.load(tmp_path / "sheet.png")[2]).max() > 0.3
    assert np.array_equal(StrokeLibrary.load(tmp_path / "theirs.npz").magnitude, magnitude)


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (("strokes", "paint", "--out", "library.zip"), "end in .npz"),
        (("strokes", "paint", "--refill-every", "0"), "0 is not from 1 to 100"),
        (("strokes", "inspect", "missing.npz"), "does not exist"),
    ],
)
def test_what_cannot_be_done_is_refused(call, tmp_path, arguments, says):
    status, said, complaint = call(*arguments)
    assert (status, said) == (2, "") and says in complaint
    assert list(tmp_path.iterdir()) == []
