"""Faces in a picture: who looks at a painting looks there first, and sees whether it is like.

They are found by a cascade of local binary patterns that comes with scikit-image (P. Viola, M. Jones, "Rapid object
detection using a boosted cascade of simple features", 2001; S. Liao et al., "Learning multi-scale block local binary
patterns for face recognition", 2007): faces that look at the camera, in photographs.
"""

from typing import NamedTuple

import torch
from torch import Tensor

from frida_painter import images

_LONGEST = 320  # pixels of the picture that is searched
_SMALLEST = 24  # pixels of a face: about as wide as a broad stroke on a canvas of 14 inches
_LIKE_SIZED = 0.6  # of the largest face, that others have: what is much smaller is mostly none
_VOTES = 12  # windows about a face that have to agree: tissue and cells had up to 7
_MORE = 6.0  # times more than elsewhere matters what is in a face
_AROUND = 1.25  # times its box: hair and chin
_SOFT = 0.25  # of the radius, over which that falls off


class Face(NamedTuple):
    """Where a face is: its middle, and its height and width, as shares of the picture's height and width."""

    row: float
    column: float
    height: float
    width: float


def faces(picture: Tensor) -> list[Face]:
    """The faces of a picture, sRGB [3, H, W]; the largest comes first."""
    from skimage import data
    from skimage.feature import Cascade

    rows, columns = (max(1, round(side * _LONGEST / max(picture.shape[1:]))) for side in picture.shape[1:])
    if min(rows, columns) < _SMALLEST:
        return []
    seen = (images.fit(picture, rows, columns).permute(1, 2, 0) * 255).round().byte().cpu().numpy()
    found = Cascade(data.lbp_frontal_face_cascade_filename()).detect_multi_scale(
        img=seen,
        scale_factor=1.1,
        step_ratio=1,
        min_size=(_SMALLEST, _SMALLEST),
        max_size=(min(rows, columns), min(rows, columns)),
        min_neighbor_number=_VOTES,
    )
    boxes = sorted(found, key=lambda box: -box["width"])
    boxes = [box for box in boxes if box["width"] >= _LIKE_SIZED * boxes[0]["width"]]
    return [
        Face(
            (box["r"] + box["height"] / 2) / rows,
            (box["c"] + box["width"] / 2) / columns,
            box["height"] / rows,
            box["width"] / columns,
        )
        for box in boxes
    ]


def importance_of(found: list[Face], rows: int, columns: int) -> Tensor:
    """How much each place of a picture with these faces matters, [rows, columns], 1 in the mean."""
    down = ((torch.arange(rows) + 0.5) / rows)[:, None]
    across = ((torch.arange(columns) + 0.5) / columns)[None]
    inside = torch.zeros(rows, columns)
    for face in found:
        radii = _AROUND * face.height / 2, _AROUND * face.width / 2
        far = (((down - face.row) / radii[0]).square() + ((across - face.column) / radii[1]).square()).sqrt()
        inside = torch.maximum(inside, ((1 + _SOFT - far) / _SOFT).clamp(0, 1))
    matters = 1 + _MORE * inside
    return matters / matters.mean()
