"""How long painting takes at the robot: what it is spent on, and when each stroke is done."""

from dataclasses import dataclass

DRYING = 600.0
"""Seconds that a layer is let dry before the next one goes on it: what thin acrylic paint needs in a warm room."""


@dataclass(frozen=True)
class Timetable:
    """Seconds of the robot's clock that painting takes.

    strokes: on the canvas; dips; washing: rinses and wipes; travel: between all of these; looks: going
    aside and coming back; drying: of layers before the next one; after: seconds from the beginning until each
    stroke is painted.
    """

    strokes: float = 0.0
    dips: float = 0.0
    washing: float = 0.0
    travel: float = 0.0
    looks: float = 0.0
    drying: float = 0.0
    after: tuple[float, ...] = ()

    @property
    def total(self) -> float:
        """Seconds for everything."""
        return self.strokes + self.dips + self.washing + self.travel + self.looks + self.drying
