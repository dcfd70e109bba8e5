"""Faces that are found in photographs, and how much more they matter."""

from pathlib import Path

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from frida_painter import images
from frida_painter.objectives.attention import Face, faces, importance_of
from frida_painter_lab import targets

SHARE = st.floats(0, 1)


def photograph(name: str) -> torch.Tensor:
    return images.load(Path(targets.__file__).with_name(f"{name}.jpg"))


def test_a_face_is_found_where_it_is_and_none_where_there_is_none() -> None:
    (face,) = faces(photograph("astronaut"))
    assert face.row == pytest.approx(0.2, abs=0.05) and 0.15 < face.width < 0.35
    assert face.column == pytest.approx(0.44, abs=0.05)
    assert faces(photograph("coffee")) == [] and faces(photograph("rocket")) == []


@pytest.mark.parametrize("shape", [(3, 1, 1), (3, 5, 400), (3, 30, 30), (3, 900, 40)])
def test_no_picture_is_too_small_or_too_narrow_to_be_searched(shape: tuple[int, ...]) -> None:
    assert faces(torch.full(shape, 0.5)) == []


@given(st.lists(st.builds(Face, SHARE, SHARE, st.floats(0.05, 1), st.floats(0.05, 1)), max_size=4))
def test_importance_is_one_in_the_mean_and_never_nothing(found: list[Face]) -> None:
    matters = importance_of(found, 40, 60)
    assert matters.shape == (40, 60) and float(matters.mean()) == pytest.approx(1, rel=1e-4)
    assert float(matters.min()) > 0.1 and float(matters.max()) <= 7 * float(matters.min()) * 1.0001


def test_a_face_matters_seven_times_as_much_as_what_is_far_from_it() -> None:
    matters = importance_of([Face(0.5, 0.25, 0.3, 0.2)], 80, 100)
    assert float(matters[40, 25] / matters[40, 90]) == pytest.approx(7)
    assert 1 < float(matters[40, 25 + 14] / matters[40, 90]) < 7, "it ends softly"
