"""How long painting takes at the robot: what it is spent on, and when each stroke is done."""

from dataclasses import dataclass, replace

DRYING = 1200.0
"""Seconds that a layer is let dry before the next one goes on it, unless somebody says otherwise.

Winsor & Newton ("Understanding drying times for acrylic paints") give 10 to 20 minutes for thin films of Galeria and
20 to 30 for thin films of Professional Acrylic.
"""


@dataclass(frozen=True)
class Timetable:
    """Seconds of the robot's clock that painting takes.

    strokes: on the canvas; dips; washing: rinses and wipes; changes: of brushes at the rack;
    travel: between all of these; looks: going
    aside and coming back; drying: of layers before the next one; after: seconds from the beginning until each
    stroke is painted.
    """

    strokes: float = 0.0
    dips: float = 0.0
    washing: float = 0.0
    changes: float = 0.0
    travel: float = 0.0
    looks: float = 0.0
    drying: float = 0.0
    after: tuple[float, ...] = ()

    @property
    def total(self) -> float:
        """Seconds for everything."""
        return self.strokes + self.dips + self.washing + self.changes + self.travel + self.looks + self.drying

    def after_drying(self, seconds: float) -> "Timetable":
        """The same where the canvas dries for so many seconds before anything else."""
        return replace(self, drying=self.drying + seconds, after=tuple(seconds + done for done in self.after))
