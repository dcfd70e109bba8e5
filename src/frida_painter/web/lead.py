"""Who leads: one browser at a time has the robot do things, and what it asks is done once, and at once."""

import math
import time
from dataclasses import dataclass, field

from frida_painter.errors import Interrupted

KEPT_FOR = 60.0
"""Seconds after its last order in which a browser still leads."""
GOOD_FOR = 10.0
"""Seconds in which an order has to arrive after it was given."""


class Led(Interrupted):
    """Another browser leads; this one may take over."""


@dataclass
class Lead:
    """Lets in orders of one browser, each with a nonce of its own and the time at which it was given.

    A browser that slept, or a request that hung, brings its order too late: then nobody expects it any more.
    """

    _leads: str = field(default="", init=False)
    _until: float = field(default=0.0, init=False)
    _used: dict[str, float] = field(default_factory=dict, init=False)

    def require(self, session: str, nonce: str, given: float) -> None:
        """Takes note of an order given at `given` (seconds since 1970, by this machine's clock) by that session.

        Raises Led where another browser leads, Interrupted where the order is an old one or was done already.
        """
        now = time.time()
        self._used = {known: at for known, at in self._used.items() if now - at <= 4 * GOOD_FOR}
        if not (16 <= len(nonce) <= 64 and math.isfinite(given)):
            raise Interrupted("This was asked without a number and a time of its own; reload the page.")
        if not -GOOD_FOR <= now - given <= GOOD_FOR:
            raise Interrupted("This was asked too long ago to be done now; look at the page, and ask again.")
        if nonce in self._used:
            raise Interrupted("This was asked already, and is done once.")
        if self._leads != session and time.monotonic() < self._until:
            raise Led("Another browser leads the painting at the moment.")
        self._used[nonce] = now
        self.take(session)

    def take(self, session: str) -> None:
        """From now on that session leads."""
        self._leads, self._until = session, time.monotonic() + KEPT_FOR
