"""Pictures compared with the ones that a person has looked at and found good."""

from pathlib import Path

import torch
from torch import Tensor
from torch.nn import functional

from frida_painter.system import images


class Snapshots:
    """Compares pictures sRGB [3, H, W] with PNG files in `folder`; what differs is left in `scratch`.

    With `renew` the files are written instead, for a person to look at before they are committed.
    """

    def __init__(self, folder: Path, scratch: Path, *, renew: bool = False) -> None:
        self.folder = folder
        self.scratch = scratch
        self.renew = renew

    def check(self, name: str, picture: Tensor, *, mean: float = 0.004, worst: float = 0.08) -> None:
        """Fails where the mean difference, or that of any patch of 5 x 5 pixels, is above what is allowed."""
        path = self.folder / f"{name}.png"
        if self.renew:
            images.save(picture, path)
            return
        assert path.exists(), f"{path} does not exist; run pytest --renew-snapshots, look at it, commit it"
        wanted = images.load(path)
        actual = self.scratch / f"{name}.png"
        images.save(picture, actual)
        assert picture.shape == wanted.shape, f"{actual} is {tuple(picture.shape)}, {path} is {tuple(wanted.shape)}"
        apart = (images.load(actual) - wanted).abs()
        patches = functional.avg_pool2d(apart[None], 5, stride=1, padding=2)
        found = (float(apart.mean()), float(patches.max()))
        assert found[0] <= mean and found[1] <= worst, (
            f"{actual} differs from {path}: {found[0]:.4f} on the mean (allowed {mean}), "
            f"{found[1]:.3f} at worst (allowed {worst}); if it is meant to, run pytest --renew-snapshots and look"
        )


def shrunk(picture: Tensor, rows: int) -> Tensor:
    """The picture at `rows` rows, so that snapshots stay small."""
    return images.fit(picture, rows, round(rows * picture.shape[2] / picture.shape[1])).to(torch.float32)
