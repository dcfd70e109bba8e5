"""The brushes in the studio's jar, by name, with all that the simulation knows about each."""

from dataclasses import dataclass

from frida_painter.errors import ConfigError


@dataclass(frozen=True)
class BristleBrush:
    """A round bristle brush held upright; lengths in millimetres, volumes in microlitres.

    bristles:         how many are simulated, each standing for a lock of hairs
    light_radius:     of the tuft at the lightest touch
    hard_radius:      of the tuft at the hardest press
    press_depth:      from the lightest touch to the hardest press
    drag:             how far the tuft trails behind the handle at the hardest press; the softer the longer
    closing:          how fast a spread tuft closes again when it is raised, mm per mm painted
    capacity:         paint that a full tuft holds
    film:             wet film that a full tuft leaves
    lengths, bends:   (least, most) of the strokes that the brush paints well, mm
    """

    name: str
    bristles: int
    light_radius: float
    hard_radius: float
    press_depth: float
    drag: float
    closing: float
    capacity: float
    film: float
    lengths: tuple[float, float]
    bends: tuple[float, float]

    def radius(self, depth: float) -> float:
        """Of the tuft at a depth between 0 (lightest touch) and 1 (hardest press)."""
        return self.light_radius + (self.hard_radius - self.light_radius) * depth


_JAR = (
    BristleBrush("fine", 190, 3.1, 5.0, 4.0, 5.0, 0.05, 38.0, 0.06, (10.0, 50.0), (-20.0, 20.0)),
    BristleBrush("medium", 300, 2.2, 8.2, 6.0, 6.5, 0.08, 64.0, 0.06, (12.0, 60.0), (-20.0, 20.0)),
    BristleBrush("broad", 480, 1.9, 14.0, 8.0, 9.0, 0.12, 140.0, 0.06, (12.0, 75.0), (-22.0, 22.0)),
)


def brush_named(name: str) -> BristleBrush:
    """The brush of that name. Raises ConfigError."""
    for brush in _JAR:
        if brush.name == name:
            return brush
    raise ConfigError(f"There is no brush {name!r} in the virtual studio; take {', '.join(brush_names())}.")


def brush_names() -> tuple[str, ...]:
    """Names of all brushes, from the finest to the broadest."""
    return tuple(brush.name for brush in _JAR)
