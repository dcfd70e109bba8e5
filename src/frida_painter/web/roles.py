"""The roles of those who use the studio."""

from enum import IntEnum


class Role(IntEnum):
    """What somebody may do; each may do what those before may."""

    watch = 1
    plan = 2
    operate = 3
