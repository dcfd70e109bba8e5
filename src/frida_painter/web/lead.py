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
    The page that gave the last order may give the lead back when it is left.
    """

    _leads: str = field(default="", init=False)
    _page: str = field(default="", init=False)
    _until: float = field(default=0.0, init=False)
    _used: dict[str, float] = field(default_factory=dict, init=False)

    def require(self, session: str, nonce: str, given: float, page: str = "") -> None:
        """Takes note of an order given at `given` (seconds since 1970, by this machine's clock) on a page of a session.

        Raises Led where another browser leads, Interrupted where the order is an old one or was done already.
        """
        self._require_new(nonce, given)
        if self._leads != session and time.monotonic() < self._until:
            raise Led("Another browser leads the painting at the moment.")
        self._take(session, nonce, page)

    def take_over(self, session: str, nonce: str, given: float, page: str = "") -> None:
        """From now on that session leads, by that page of it. Raises Interrupted as `require` does."""
        self._require_new(nonce, given)
        self._take(session, nonce, page)

    def give_back(self, session: str, page: str) -> bool:
        """Lets anybody lead where that page gave the last order; elsewhere nothing changes. Returns whether it did."""
        held = (self._leads, self._page) == (session, page) and time.monotonic() < self._until
        if held:
            self._until = 0.0
        return held

    def _require_new(self, nonce: str, given: float) -> None:
        now = time.time()
        self._used = {known: at for known, at in self._used.items() if now - at <= 4 * GOOD_FOR}
        if not (16 <= len(nonce) <= 64 and math.isfinite(given)):
            raise Interrupted("This was asked without a number and a time of its own; reload the page.")
        if not -GOOD_FOR <= now - given <= GOOD_FOR:
            raise Interrupted("This was asked too long ago to be done now; look at the page, and ask again.")
        if nonce in self._used:
            raise Interrupted("This was asked already, and is done once.")

    def _take(self, session: str, nonce: str, page: str) -> None:
        self._used[nonce] = time.time()
        self._leads, self._page, self._until = session, page, time.monotonic() + KEPT_FOR
