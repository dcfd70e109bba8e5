"""A replan policy: the painter looks more and more often towards the end, where dark strokes do the damage."""

from dataclasses import dataclass
from typing import Self

from frida_painter.plugins import CanvasSeen, ConfigError


@dataclass(frozen=True)
class Late:
    """Looks after `share` of the strokes that are left, each time. 0 < share < 1; raises ConfigError."""

    share: float

    def __post_init__(self) -> None:
        if not 0 < self.share < 1:
            raise ConfigError(f"A share of {self.share} was given; it is between 0 and 1, such as late:0.5.")

    @classmethod
    def parse(cls, argument: str) -> Self:
        """From what follows the colon in "late:0.5". Raises ConfigError."""
        try:
            return cls(float(argument))
        except ValueError:
            raise ConfigError(f"A share of {argument[:40]!r} was given; write for example late:0.5.") from None

    def next_look(self, done: int, of: int) -> int:
        """After that share of what is left, but at least one stroke."""
        return min(of, done + max(1, round(self.share * (of - done))))

    def wants_replan(self, seen: CanvasSeen) -> bool:
        """Always."""
        return True
