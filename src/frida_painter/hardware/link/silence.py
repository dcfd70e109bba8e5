"""When a robot is stopped because its painting process fell silent: the rule alone, without clocks or processes.

A silent process may be dead, or merely slow. The rule therefore does not count time in which the process
could not have spoken: time in which it was ready to run and no processor was free, and time in which the
watch itself did not run. Upper bounds hold whatever the reason.
"""

import math
from dataclasses import dataclass

LOOK_EVERY = 0.02
_USUAL = 0.1  # seconds between two looks that nobody has to explain


@dataclass(frozen=True)
class Patience:
    """Limits in seconds; infinity where there is none.

    silence: that counts, before the robot is stopped; starved_moving: of any kind, while something moves;
    absence: of any kind, while nothing moves, and also that of a process that computes; standstill: of the watch
    itself, within a motion; nap: of the computer; orphaned: within a motion, once the painting process is gone.
    """

    silence: float = 2.5
    starved_moving: float = 10.0
    absence: float = 30.0
    standstill: float = 3.0
    nap: float = 1.0
    orphaned: float = 2.5


# A robot is stopped within 3 s of silence; half a second of it is for the stop itself.
MACHINE = Patience()
# A simulated robot hurts nobody: whoever commands it is waited for as long as it exists.
SIMULATED = Patience(silence=math.inf, starved_moving=math.inf, absence=math.inf, standstill=math.inf, nap=math.inf)


@dataclass(frozen=True)
class LinkState:
    """What is seen at one moment.

    at: seconds; moving: whether a motion is on its way; gone: whether the painting process closed its line;
    thinking: whether it took processor time of late; starved: seconds so far in which it was ready to run and
    had no processor, None where nobody looked.
    """

    at: float
    moving: bool
    gone: bool = False
    thinking: bool = False
    starved: float | None = None


class SilenceRule:
    """Is told of every heartbeat and shown every look, in the order of time."""

    def __init__(self, now: float, patience: Patience = MACHINE) -> None:
        self._patience = patience
        self._heard = self._still = _Span(now)
        self._looked, self._moved = now, False

    def hear(self, at: float) -> None:
        """A heartbeat came."""
        self._heard = _Span(at)

    def silence(self, at: float) -> float:
        """Seconds since the last heartbeat."""
        return at - self._heard.since

    def judge(self, look: LinkState) -> str | None:
        """Why the robot is to be stopped; None where it is not. A silence is reported once, then counted anew."""
        late = max(look.at - self._looked - _USUAL, 0.0)
        stood_still = late if self._moved else 0.0
        self._looked, self._moved = look.at, look.moving
        if not look.moving:
            self._still = _Span(look.at)
        for span in (self._heard, self._still):
            span.notice(look, late)
        if stood_still > self._patience.standstill:
            self._heard = self._still = _Span(look.at)
            return f"the easel's process was held up for {stood_still:.1f} s in the middle of a motion"
        if not self._too_long(look):
            return None
        absent = self.silence(look.at)
        self._heard = self._still = _Span(look.at)
        return f"the painting process fell silent for {absent:.1f} s"

    def _too_long(self, look: LinkState) -> bool:
        most = self._patience
        if look.moving:
            # Whoever asked for a motion was there when it began.
            span = self._heard if self._heard.since >= self._still.since else self._still
            if look.gone:
                return span.counted(look) > most.orphaned
            return span.counted(look) > most.silence or look.at - span.since > most.starved_moving
        if look.gone:
            return False  # nothing can move any more
        if look.at - self._heard.since > most.absence:
            return True
        return self._heard.counted(look) > most.silence and not look.thinking


class _Span:
    """A time that has lasted since a moment, and how much of it nobody could have spoken in."""

    def __init__(self, since: float) -> None:
        self.since = since
        self._late = self._starved = 0.0
        self._starved_before: float | None = None
        self._noticed = False

    def notice(self, look: LinkState, late: float) -> None:
        self._late += late if self._noticed else min(late, look.at - self.since)
        self._noticed = True
        if look.starved is not None:
            if self._starved_before is None:
                self._starved_before = look.starved
            self._starved = look.starved - self._starved_before

    def counted(self, look: LinkState) -> float:
        """Seconds that count: without those in which the process, or the watch, had no processor."""
        return look.at - self.since - max(0.0 if look.gone else self._starved, self._late)
