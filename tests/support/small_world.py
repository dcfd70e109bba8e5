"""Paintings that cost as much as a test may: a brush that is looked up coarsely, and photographs of few pixels."""

from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache

import pytest
from torch import Tensor

from frida_painter.objectives import attention
from frida_painter.objectives.attention import Face
from frida_painter.perception import registration
from frida_painter.planning import materials
from frida_painter.session import open_loop, plan_keeper, resuming
from frida_painter.virtual.camera import CameraSpec
from marks import coarse_table

PHOTOGRAPH = (180, 240)
"""Rows and columns of a photograph on which a canvas of some centimetres and its corners are found all the same."""
ROWS = 216
"""Rows of the canvas as it is cut out of a photograph, otherwise 864."""
REGISTRATION_ROWS = 80
"""Rows of the canvas as it is looked at for a motion, otherwise 250: that takes most of the time of a look."""


@contextmanager
def small_world(photograph: tuple[int, int] = PHOTOGRAPH) -> Iterator[None]:
    """Within it, in this process and those forked from it, whatever asks for no size of its own is small.

    photograph: rows and columns of the virtual studio's camera, otherwise 1200 and 1600
    """
    init = CameraSpec.__init__
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(init, "__defaults__", (photograph, *init.__defaults__[1:]))
        patch.setattr(materials, "cached_table", coarse_table)
        for user in (open_loop, plan_keeper, resuming):
            patch.setattr(user, "PHOTOGRAPH_ROWS", ROWS)
        patch.setattr(registration, "_ROWS", REGISTRATION_ROWS)
        patch.setattr(registration, "COARSEST", registration.MAX_SHIFT)
        patch.setattr(attention, "faces", _known_faces)
        yield


_REGISTRATION = registration._ROWS, registration.COARSEST


@contextmanager
def fine_registration() -> Iterator[None]:
    """Within `small_world`: motions of the canvas are looked for as finely as for people."""
    with pytest.MonkeyPatch.context() as patch:
        for name, value in zip(("_ROWS", "COARSEST"), _REGISTRATION, strict=True):
            patch.setattr(registration, name, value)
        yield


_find_faces = attention.faces


def _known_faces(picture: Tensor) -> list[Face]:
    """As `faces`, which looks at a picture only once."""
    seen = hash((tuple(picture.shape), picture.contiguous().numpy().tobytes()))
    if seen not in _faces_found():
        _faces_found()[seen] = tuple(_find_faces(picture))
    return list(_faces_found()[seen])


@cache
def _faces_found() -> dict[int, tuple[Face, ...]]:
    """What was found in this process, by the picture."""
    return {}
