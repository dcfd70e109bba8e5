"""Replan policies: they decide when the painter looks at the canvas, and whether it replans the rest."""

import itertools
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol, Self, cast

from frida_painter.errors import ConfigError
from frida_painter.registry import REPLAN_POLICIES, parts

_MAX = 20_000
_FIRST = 10  # strokes of a first batch


@dataclass(frozen=True)
class CanvasSeen:
    """Result of a look.

    done, left: numbers of painted and of planned strokes.
    error: mean difference between the seen and the expected canvas, over pixels and sRGB channels, in [0, 1].
    gain: dB by which the last replan lowered the expected loss, None before the first one.
    """

    done: int
    left: int
    error: float
    gain: float | None = None


class ReplanPolicy(Protocol):
    """Decides when the painter looks and whether it replans."""

    def next_look(self, done: int, of: int) -> int:
        """Returns the number of painted strokes at the next look, above `done` and at most `of`.

        The painter always looks after the last stroke.
        """

    def wants_replan(self, seen: CanvasSeen) -> bool:
        """Returns True if the rest is to be replanned."""


@dataclass(frozen=True)
class EvenlySpaced:
    """Looks and replans a fixed number of times, after batches that differ by at most one stroke.

    With at least two replans and longer batches, the first batch has ten strokes, which show where strokes land.
    layers: strokes of each layer, if the plan has several. Then the start of each later layer is one of the looks,
    and the other looks halve the longest batches.
    """

    replans: int
    layers: tuple[int, ...] = ()

    def __post_init__(self) -> None:
        _require_count("replans", self.replans, 0)

    @classmethod
    def parse(cls, argument: str) -> Self:
        """Parses a number such as "4". Raises ConfigError."""
        return cls(_whole("replans", argument))

    def batches(self, strokes: int) -> list[int]:
        """Returns the numbers of strokes between looks: `replans` + 1 batches if there are as many strokes."""
        if self.replans and len(self.layers) > 1 and sum(self.layers) == strokes:
            return self._inside_layers()
        count = min(self.replans + 1, strokes)
        first = _FIRST if count > 2 and strokes > _FIRST * count else 0
        rest, even = strokes - first, count - 1 if first else count
        return [*([first] if first else []), *(rest * (at + 1) // even - rest * at // even for at in range(even))]

    def _inside_layers(self) -> list[int]:
        batches = [size for size in self.layers if size]
        if self.replans >= len(batches) and batches[0] > 2 * _FIRST:
            batches[:1] = [_FIRST, batches[0] - _FIRST]
        while len(batches) <= self.replans and max(batches) > 1:
            at = batches.index(max(batches))
            batches[at : at + 1] = [(batches[at] + 1) // 2, batches[at] // 2]
        return batches

    def next_look(self, done: int, of: int) -> int:
        """Returns the end of the batch."""
        return next(end for end in itertools.accumulate(self.batches(of)) if end > done)

    def wants_replan(self, seen: CanvasSeen) -> bool:
        """Returns True."""
        return True


@dataclass(frozen=True)
class EveryNth:
    """Looks after every `strokes` strokes; replans always, or only if the canvas error exceeds the given `tolerance`.

    tolerance: limit of CanvasSeen.error, in [0, 1]. None: it always replans.
    """

    strokes: int
    tolerance: float | None = None

    def __post_init__(self) -> None:
        _require_count("strokes between two looks", self.strokes, 1)
        if not 0 <= (self.tolerance or 0) <= 1:
            raise ConfigError(f"A tolerance of {self.tolerance} was given; it is from 0 to 1, such as 0.02.")

    @classmethod
    def parse(cls, argument: str) -> Self:
        """Parses a number such as "75". Raises ConfigError."""
        return cls(_whole("strokes between two looks", argument))

    @classmethod
    def when_off_by(cls, argument: str) -> Self:
        """Parses a tolerance such as "0.02", or "0.02,25" with the strokes between looks. Raises ConfigError."""
        tolerance, comma, strokes = argument.partition(",")
        try:
            off = float(tolerance)
        except ValueError:
            raise ConfigError(f"A tolerance of {tolerance[:40]!r} was given; it is from 0 to 1.") from None
        return cls(_whole("strokes between two looks", strokes) if comma else _FIRST, off)

    @classmethod
    def never(cls) -> Self:
        """Returns the policy without a camera: the plan is painted as it is."""
        return cls(_MAX, 1.0)

    def next_look(self, done: int, of: int) -> int:
        """Returns the next multiple of `strokes`."""
        return min(of, (done // self.strokes + 1) * self.strokes)

    def wants_replan(self, seen: CanvasSeen) -> bool:
        """Returns True if the error exceeds the tolerance, or if there is none."""
        return self.tolerance is None or not seen.error <= self.tolerance


@dataclass
class WhenItPays:
    """Looks and replans as often as each replan lowers the expected loss by `least` dB, because looks take time.

    The last gain predicts the next one. After a sufficient gain, the distance to the next look is halved, otherwise
    doubled.
    between: strokes between looks.
    since: number of painted strokes at the last look.
    """

    least: float = 0.05
    between: int = 20
    since: int = _FIRST - 20

    def __post_init__(self) -> None:
        if not 0 < self.least <= 10:
            raise ConfigError(
                f"A gain of {self.least} dB a look was given; it is above 0 and at most 10, such as 0.05."
            )

    @classmethod
    def parse(cls, argument: str) -> Self:
        """Parses a number such as "0.05"; "" gives the default. Raises ConfigError."""
        try:
            return cls(float(argument)) if argument.strip() else cls()
        except ValueError:
            raise ConfigError(f"A gain of {argument[:40]!r} a look was given; it is a number of dB.") from None

    def next_look(self, done: int, of: int) -> int:
        """Returns the next look, `between` strokes after the last one."""
        return min(of, self.since + max(1, (done - self.since) // self.between + 1) * self.between)

    def wants_replan(self, seen: CanvasSeen) -> bool:
        """Returns True, because only a replan shows its gain; adapts `between` to the last gain."""
        if seen.gain is not None:
            between = self.between // 2 if seen.gain >= self.least else self.between * 2
            self.between = min(max(between, _FIRST), _MAX)
        self.since = seen.done
        return True


def looks_on_the_way(policy: ReplanPolicy, strokes: int) -> list[int]:
    """Returns the numbers of painted strokes at each look, without the look after the last stroke."""
    looks, done = [], 0
    while done < strokes:
        done = policy.next_look(done, strokes)
        looks.append(done)
    return looks[:-1]


def parse_replan_policy(text: str) -> ReplanPolicy:
    """Returns the replan policy that a text names.

    The text is "4" (number of replans), "every:75", "when-off-by:0.02", "when-it-pays", or the name of a plugin's
    policy.
    Raises ConfigError for an unknown name or a wrong argument.
    """
    name, _, argument = text.strip().partition(":")
    if name.isdecimal() and not argument:
        name, argument = "times", name
    known = parts(REPLAN_POLICIES)
    if name not in known:
        raise ConfigError(
            f"There is no replan policy {text[:60]!r}; there are {', '.join(sorted(known))}: give a number, or "
            "for example every:75, when-off-by:0.02 or when-it-pays:0.05."
        )
    parse = cast(Callable[[str], ReplanPolicy], known[name].load(object))
    return parse(argument)


def _whole(what: str, text: str) -> int:
    if not text.strip().isdecimal():
        raise ConfigError(f"{text[:40]!r} {what} were given; give a whole number.")
    return int(text)


def _require_count(what: str, count: int, least: int) -> None:
    if not least <= count <= _MAX:
        raise ConfigError(f"{count} {what} were given; allowed are {least} to {_MAX}.")
