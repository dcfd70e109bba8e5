"""Pictures of the canvas that people take: from any side, in any light, and of other canvases."""

from functools import cache

import cv2
import numpy as np
import pytest
import torch
from torch import Tensor

from frida_painter.canvas_size import CanvasSize
from frida_painter.errors import CalibrationError, FrameRejected
from frida_painter.perception.snapshot import find_corners, read_snapshot
from support.telephone import taken

SIZE = CanvasSize(0.28, 0.2)
ROWS, COLUMNS = 432, 605
PAPER = torch.ones(3, ROWS, COLUMNS)


@cache
def painted(seed: int, strokes: int = 14) -> Tensor:
    """Broad strokes on white paper; drawn here, by none of the program's renderers."""
    chance = np.random.default_rng(seed)
    paper = np.full((ROWS, COLUMNS, 3), 255, np.uint8)
    for _ in range(strokes):
        start = chance.uniform(0.1, 0.9, 2) * (COLUMNS, ROWS)
        end = start + chance.uniform(-120, 120, 2)
        color = tuple(int(part) for part in chance.uniform(20, 200, 3))
        cv2.line(paper, start.astype(int).tolist(), end.astype(int).tolist(), color, 26, cv2.LINE_AA)
    return torch.from_numpy(paper).permute(2, 0, 1).float() / 255


@pytest.mark.parametrize("quarter", [0, 1, 2, 3])
def test_the_canvas_is_rectified_upright_and_in_true_colours_from_every_side(quarter: int) -> None:
    wanted = painted(1)
    picture, corners = taken(wanted, 3, quarter)
    found = find_corners(picture, SIZE)
    if quarter == 0:
        assert np.abs(np.array(found) - corners).max() < 1.5, "pixels"
    snapshot = read_snapshot(picture, found, SIZE, PAPER, wanted)
    assert snapshot.shown == pytest.approx(1, abs=0.05) and snapshot.alike > 0.98
    assert float((snapshot.canvas - wanted).abs().mean()) < 0.02


def test_what_is_there_is_seen_and_not_what_was_expected() -> None:
    """Half of the strokes came out fainter and one is missing: the light must not hide that."""
    wanted = painted(1)
    real = wanted.clone()
    real[:, :, : COLUMNS // 2] = 1 - 0.6 * (1 - real[:, :, : COLUMNS // 2])
    picture, corners = taken(real, 4)
    snapshot = read_snapshot(picture, tuple(map(tuple, corners.tolist())), SIZE, PAPER, wanted)
    assert float((snapshot.canvas - real).abs().mean()) < 0.5 * float((wanted - real).abs().mean())


@pytest.mark.parametrize("other", [painted(2), painted(7, 30), PAPER], ids=["other", "fuller", "blank"])
def test_another_canvas_is_refused_in_one_sentence(other: Tensor) -> None:
    picture, corners = taken(other, 5)
    with pytest.raises(FrameRejected, match=r"does not show this canvas|nobody painted") as refusal:
        read_snapshot(picture, tuple(map(tuple, corners.tolist())), SIZE, PAPER, painted(1))
    assert "\n" not in str(refusal.value)


def test_a_hand_on_the_unpainted_canvas_is_refused() -> None:
    covered = painted(1, 3).clone()
    covered[:, 200:, 250:] = torch.tensor([0.8, 0.6, 0.5])[:, None, None]
    picture, corners = taken(covered, 6)
    with pytest.raises(FrameRejected):
        read_snapshot(picture, tuple(map(tuple, corners.tolist())), SIZE, PAPER, painted(1, 3))


def test_a_picture_without_a_canvas_is_refused() -> None:
    with pytest.raises(CalibrationError, match="cannot be told from what is around it"):
        find_corners(np.full((300, 400, 3), 90, np.uint8), SIZE)
