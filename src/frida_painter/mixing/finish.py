"""The surface of dry paint."""

from enum import StrEnum


class Finish(StrEnum):
    """What the surface of the dry paint does with light: scatters it to every side, or mirrors it past the eye."""

    matte = "matte"
    gloss = "gloss"
