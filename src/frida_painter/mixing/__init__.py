"""Mixing of paints: colours of mixtures, recipes, and the surface of dry paint."""

from enum import StrEnum


class Finish(StrEnum):
    """Surface of dry paint: matte scatters light in all directions, gloss reflects it away from the eye."""

    matte = "matte"
    gloss = "gloss"
