"""The easel's process as the painting process sees it: an easel like any other.

It starts before the heavy imports here: both processes then load at the same time.
"""

import math
import signal
import subprocess
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import TracebackType
from typing import TYPE_CHECKING, Self

from frida_painter.errors import FridaError, ProcessLost, RobotDisconnected, RobotError
from frida_painter.system import operating_system, python_process
from frida_painter.system.messages import decode_error

if TYPE_CHECKING:
    from frida_painter.easel.connection import Link
    from frida_painter.easel.order import EaselOrder
    from frida_painter.hardware.easel import Easel

_OPENING = 600.0  # seconds
_ENDING = 30.0


class EaselProcess:
    """Process of an easel, started at once. Used in a `with` block, which ends it; the block may be entered again.

    robot: name of the easel that will be ordered, to be loaded early; "" if it is not known yet
    """

    def __init__(self, robot: str = "") -> None:
        self._line, its_line = operating_system.socket_pair()
        # Its error output is never shown on the painter's terminal.
        self._complaints = tempfile.TemporaryFile()  # noqa: SIM115 (closed with the process)
        with its_line:
            self._process, self._wire = python_process.start_function(
                "frida_painter.easel.host:serve_easel", {"line": its_line, "name": robot},
                stdout=subprocess.DEVNULL, stderr=self._complaints,
                **operating_system.APART,  # Ctrl-C at the terminal is for the painting process only
            )  # fmt: skip
        self._link: Link | None = None
        self._opened = self._over = False

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._over:
            return
        self._over = True
        try:
            if not self._opened:
                self._process.kill()  # it moves nothing yet
            if self._link is not None:
                self._link.end(ask=self._opened)
        except FridaError:
            if error is None:
                raise
        finally:
            self._wire.close()
            self._line.close()
            try:
                self._process.wait(_ENDING)
            except subprocess.TimeoutExpired:
                self._process.kill()
                self._process.wait()
            self._complaints.close()

    def open(self, order: "EaselOrder", tell: Callable[[str], None] = lambda remark: None) -> "Easel":
        """Returns the ordered easel; its robot and camera are not connected yet.

        tell: receives sentences of the easel's process for people

        Raises RobotStopped if a person must re-arm it first, RobotBusy if another process has it, ConfigError or
        StorageError if it cannot be opened, RobotDisconnected if its process died.
        """
        from pydantic import TypeAdapter

        from frida_painter.easel.connection import Link, make_remote
        from frida_painter.easel.kinds import easel_kind, is_simulated
        from frida_painter.easel.order import FACTS, EaselFacts, EaselOrder
        from frida_painter.hardware.easel import Easel
        from frida_painter.hardware.latch import Unlatched, latch_of

        wire = self._wire
        self._link = link = Link(wire, self._line, self._process, tell)
        try:
            wire.send({"order": TypeAdapter(EaselOrder).dump_python(order, mode="json")})
            # A simulated easel may take any time, for example to replay its diary of many thousand strokes; the death
            # of its process ends the wait at once.
            about, _ = wire.receive(math.inf if is_simulated(order.robot) else _OPENING)
        except ProcessLost as gone:
            lost = python_process.describe_end(self._process, wire, gone, self._complaints)
            raise RobotDisconnected(f"The easel's process did not start ({lost})") from gone
        if "error" in about:
            raise decode_error(about, RobotError)
        self._opened = True
        facts = TypeAdapter(EaselFacts).validate_python(about["facts"])
        if is_simulated(order.robot):  # a slow computer is not a fault
            link.patience = link.most_silence = math.inf
        kind, known_as = easel_kind(order.robot), facts.calibration.easel
        alive = kind is not None and (kind.simulated or kind.person)  # nothing of it moves by itself
        link.latch = Unlatched(known_as) if alive else latch_of(order.state, known_as, about["machines"])
        return Easel(
            robot=make_remote("robot", link.call, stop=link.pulse.stop),  # stops go over the separate line
            camera=make_remote("camera", link.call),
            operator=make_remote("operator", link.call),
            **{name: getattr(facts, name) for name in FACTS},
        )

    @property
    def stopped(self) -> bool:
        """True if the robot was stopped for any reason: later motions are not painted."""
        return self._link is not None and self._link.pulse.stopped

    @contextmanager
    def hearing_signals(self) -> Iterator[None]:
        """Passes signals on to the open easel's process from the system's own handler, even while Python is busy.

        Works only for signals with a handler, and in the main thread.
        """
        before = signal.set_wakeup_fd(self._line.fileno(), warn_on_full_buffer=False)
        try:
            yield
        finally:
            signal.set_wakeup_fd(before)
