"""Which OpenGL draws pictures without a screen on this machine, and what to install where there is none."""

import ctypes.util
import os
import sys

_KINDS = {"egl": "EGL", "osmesa": "OSMesa"}

NONE = (
    "The arm is not filmed, for there is no OpenGL that draws without a screen; on Debian and Ubuntu say: "
    "apt install libegl1 libgl1-mesa-dri"
)


def headless_opengl() -> str | None:
    """The name under which MuJoCo knows it ("egl", "osmesa", "cgl"); None where there is none.

    The environment's MUJOCO_GL goes before what is found.
    """
    wanted = os.environ.get("MUJOCO_GL", "").lower()
    if wanted in (*_KINDS, "cgl"):
        return wanted
    if sys.platform == "darwin":
        return "cgl"
    return next((kind for kind, library in _KINDS.items() if ctypes.util.find_library(library)), None)
