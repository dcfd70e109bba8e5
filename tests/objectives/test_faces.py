from pathlib import Path

import pytest
import torch

from frida_painter.objectives.faces import faces
from frida_painter.system import images
from frida_painter_lab import targets


def photograph(name: str) -> torch.Tensor:
    return images.load(Path(targets.__file__).with_name(f"{name}.jpg"))


def test_a_face_is_found_with_its_eyes() -> None:
    (face,) = faces(photograph("astronaut"))
    assert face.row == pytest.approx(0.22, abs=0.05) and 0.15 < face.width < 0.35
    assert face.column == pytest.approx(0.44, abs=0.05)
    (left_row, left), (right_row, right), (nose_row, nose), *mouth = face.marks
    assert left < nose < right and max(left_row, right_row) < nose_row < min(row for row, _ in mouth)


def test_no_face_is_found_where_there_is_none() -> None:
    assert faces(photograph("coffee")) == [] and faces(photograph("rocket")) == [] and faces(photograph("tissue")) == []


def test_a_face_in_profile_and_one_cut_by_the_edge_are_found() -> None:
    (profile,) = faces(photograph("cameraman"))
    assert profile.row == pytest.approx(0.3, abs=0.05) and profile.column == pytest.approx(0.45, abs=0.05)
    astronaut = photograph("astronaut")
    (cut,) = faces(astronaut[:, :, round(0.44 * astronaut.shape[2]) :])
    assert cut.column < 0.15


def test_every_one_of_many_faces_is_found_once() -> None:
    astronaut = photograph("astronaut")
    head = images.fit(astronaut[:, : astronaut.shape[1] // 2], 120, 240)[:, :, 50:170]
    assert len(faces(head.repeat(1, 5, 8))) == 40


@pytest.mark.parametrize("shape", [(3, 1, 1), (3, 5, 400), (3, 30, 30), (3, 900, 40)])
def test_no_picture_is_too_small_or_too_narrow_to_be_searched(shape: tuple[int, ...]) -> None:
    assert faces(torch.full(shape, 0.5)) == []
