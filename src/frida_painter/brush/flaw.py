"""What can be wrong with a recorded stroke, so that nobody should learn from it."""

from enum import IntEnum


class Flaw(IntEnum):
    """Why a stroke of a library is dirty; its number stands in the library's file.

    EMPTY to ASTRAY show in the mark itself, MOVED to DISTURBED only in the photographs that it was
    cut out of.
    """

    NONE = 0
    EMPTY = 1
    TOUCHED = 2
    TORN = 3
    SKIPPED = 4
    ASTRAY = 5
    MOVED = 6
    LIGHT = 7
    DISTURBED = 8

    @property
    def words(self) -> str:
        """The reason in a few words, for a contact sheet."""
        return _REASONS[self][0]

    @property
    def sentence(self) -> str:
        """The reason as part of a sentence: what is seen, and what it comes from."""
        return _REASONS[self][1]


_REASONS = {
    Flaw.NONE: ("clean", "nothing is wrong with it"),
    Flaw.EMPTY: ("nearly empty", "it has far less paint than strokes of its shape: the brush ran out or did not touch"),
    Flaw.TOUCHED: ("touching", "there is paint of something else in its picture"),
    Flaw.TORN: ("torn", "much of its inside is bare: dry paint, or paint that was there before it"),
    Flaw.SKIPPED: ("skipped", "it breaks off on its way"),
    Flaw.ASTRAY: ("astray", "it lies elsewhere than other strokes: the robot, the paper or the camera moved"),
    Flaw.MOVED: ("paper moved", "the paper or the camera moved between its two photographs"),
    Flaw.LIGHT: ("light changed", "the light changed between its two photographs by more than can be taken out"),
    Flaw.DISTURBED: ("disturbed", "something besides it changed between its two photographs: a hand, the arm, a drop"),
}
