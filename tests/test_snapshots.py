from pathlib import Path

import pytest
import torch

from frida_painter.system import images
from snapshots import Snapshots


@pytest.fixture
def picture() -> torch.Tensor:
    return torch.rand(3, 40, 60, generator=torch.Generator().manual_seed(1))


@pytest.fixture
def snapshots(tmp_path: Path, picture: torch.Tensor) -> Snapshots:
    images.save(picture, tmp_path / "kept" / "scene.png")
    return Snapshots(tmp_path / "kept", tmp_path / "scratch")


def test_the_same_picture_and_a_grain_of_difference_pass(snapshots: Snapshots, picture: torch.Tensor) -> None:
    snapshots.check("scene", picture)
    snapshots.check("scene", (picture + 0.003).clamp(0, 1))


def test_a_picture_that_is_a_little_brighter_fails(snapshots: Snapshots, picture: torch.Tensor) -> None:
    with pytest.raises(AssertionError, match="on the mean"):
        snapshots.check("scene", (picture + 0.02).clamp(0, 1))


def test_one_small_spot_fails_though_the_mean_is_as_it_was(snapshots: Snapshots, picture: torch.Tensor) -> None:
    spotted = picture.clone()
    spotted[:, 10:13, 10:13] = 1 - spotted[:, 10:13, 10:13].round()
    assert (spotted - picture).abs().mean() < 0.004
    with pytest.raises(AssertionError, match="at worst"):
        snapshots.check("scene", spotted)


def test_a_mirrored_picture_and_one_of_another_size_fail(snapshots: Snapshots, picture: torch.Tensor) -> None:
    with pytest.raises(AssertionError, match="differs"):
        snapshots.check("scene", picture.flip(2))
    with pytest.raises(AssertionError, match=r"\(3, 40, 50\)"):
        snapshots.check("scene", picture[:, :, :50])


def test_a_missing_snapshot_fails_and_renewing_writes_it(tmp_path: Path, picture: torch.Tensor) -> None:
    with pytest.raises(AssertionError, match="--renew-snapshots"):
        Snapshots(tmp_path, tmp_path / "scratch").check("new", picture)
    Snapshots(tmp_path, tmp_path / "scratch", renew=True).check("new", picture)
    Snapshots(tmp_path, tmp_path / "scratch").check("new", picture)
