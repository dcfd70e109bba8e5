"""The easel's process as the painting process sees it: an easel like any other."""

import contextlib
import math
import signal
import subprocess
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from types import TracebackType
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from frida_painter.easel.kinds import easel_kind
from frida_painter.easel.launch import EaselLaunch
from frida_painter.easel.open import is_simulated
from frida_painter.easel.order import EaselFacts, EaselOrder
from frida_painter.easel.proxy import Remote, Request, decode_error, make_remote, requests
from frida_painter.easel.watchdog import Pulse
from frida_painter.easel.wire import Arrays, Wire
from frida_painter.errors import FridaError, RobotAbandoned, RobotDisconnected
from frida_painter.hardware.easel import Easel
from frida_painter.hardware.latch import Latch, Unlatched, latch_of
from frida_painter.hardware.robot import Waypoints, Workspace
from frida_painter.hardware.timing import AxisTiming, motion_seconds

# For a process that hangs as a whole; the guard in the easel's process gives up a driver earlier.
_MARGIN = 10.0
_CALL = 60.0
_HELD = 3600.0  # the longest time for which a person may hold a machine whose controller tells so, seconds
_HOMING = 300.0
# Seconds without a heartbeat after which the process counts as hung or frozen.
_MAX_SILENCE = 10.0
_LOOK_EVERY = 0.25
_HEEDING, _WRITING = 1.0, 10.0  # within which a process that lives takes a stop, and a disk stores one
_CONNECT, _CLOSE = ("robot", "connect"), ("robot", "close")
_END = None, "end"  # the process sends no heartbeats while it closes everything


class LastStop:
    """The stop of a robot whose easel's process vanished: it is stored by the process that is left.

    latch: of the robot; None until the easel is open
    connected: True from the request to connect until the robot is closed; otherwise it cannot move
    held: True if the machine itself got a stop
    """

    def __init__(self) -> None:
        self.latch: Latch | Unlatched | None = None
        self.connected = self.held = False
        self._unkept: FridaError | None = None

    def engage(self, held: bool) -> None:
        """Stores the stop, if the robot was connected."""
        self.held = held
        if self.connected and self.latch is not None:
            try:
                self.latch.engage("its process was killed or crashed, perhaps in the middle of a motion")
            except FridaError as failure:
                self._unkept = failure

    def explain(self, why: str) -> RobotDisconnected:
        """Returns the error for people, after `engage`. why: how the process ended, in words."""
        told = f"The easel's process is gone ({why}). "
        if not self.connected or self.latch is None:
            return RobotAbandoned(f"{told}The robot was not connected, and did not move.", held=False, latched=False)
        if isinstance(self.latch, Unlatched):
            return RobotAbandoned(f"{told}It was a simulated robot; resume the painting.", held=False, latched=False)
        told += (
            "This process told the machine to hold over the same line. "
            if self.held
            else "Nobody could tell the robot to stop: what its board had received is finished. "
        )
        if self._unkept is not None:
            told += f"The stop could not be stored ({self._unkept}) Start nothing before somebody has looked at it."
        else:
            told += f"It is stopped for this program until you arm it: {self.latch.remedy}"
        return RobotAbandoned(told, held=self.held, latched=self._unkept is None)


class Link:
    """Link to the easel's process: sends one request at a time.

    last: stop of the robot if that process vanishes
    process: of the easel; it is ended if it neither answers nor takes a stop
    tell: receives sentences of the easel's process for people
    patience: default seconds to wait for an answer
    most_silence: greatest time without a heartbeat during the wait, seconds

    Raises RobotDisconnected if there is no answer, after sending a stop. The link is then broken for good.
    Raises the errors that the easel reports.
    """

    def __init__(
        self,
        wire: Wire,
        pulse: Pulse,
        last: LastStop | None = None,
        process: subprocess.Popen[bytes] | None = None,
        tell: Callable[[str], None] = lambda remark: None,
    ) -> None:
        self._wire, self.pulse, self.last, self._process, self._tell = wire, pulse, last or LastStop(), process, tell
        self.patience, self.most_silence = _CALL, _MAX_SILENCE
        self._turn = threading.Lock()
        self._broken: RobotDisconnected | None = None

    def call(self, request: Request, arguments: Mapping[str, Any], within: float | None = None) -> Any:
        """Returns the result of a request with its arguments by name; the rest is as in `ask`."""
        answer, arrays = self.ask(*request.pack(arguments), within=within)
        return request.result(answer, arrays)

    def ask(
        self, words: Mapping[str, Any], arrays: Arrays | None = None, *, within: float | None = None
    ) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
        """Returns the answer of the easel's process to a request.

        within: seconds to wait; None for the link's patience

        Raises RobotDisconnected if there is no answer, and the errors that the easel reports.
        """
        asked = words.get("part"), words["do"]
        with self._turn:
            if self._broken is not None:
                raise self._broken.with_traceback(None)
            if asked == _CONNECT:
                self.last.connected = True
            try:
                self._wire.send(words, arrays)
                answer, result = self._answer(self.patience if within is None else within, listen=asked != _END)
            except RobotDisconnected as error:
                self._broken = self._give_up(error)
                raise self._broken from error
        for remark in answer.get("remarks", ()):
            self._tell(str(remark))
        if self.last.latch is not None:
            self.last.latch.machines = frozenset(answer.get("machines", self.last.latch.machines))
        if "error" in answer:
            raise decode_error(answer)
        if asked in (_CLOSE, _END):
            self.last.connected = False
        return answer, result

    def _give_up(self, error: RobotDisconnected) -> RobotDisconnected:
        """Stops the robot by all means that are left, and returns the error for people."""
        pulse = self.pulse
        pulse.stop()
        until = time.monotonic() + _HEEDING
        while not (pulse.gone.wait(0.01) or pulse.stopped or time.monotonic() > until):
            pass
        why = ""
        if not (pulse.gone.is_set() or pulse.stopped):  # it is frozen, or hangs as a whole
            why = f"{str(error).rstrip('.')}, and it was ended"
            if self._process is not None:
                self._process.kill()
            pulse.gone.wait(_WRITING)
        if pulse.gone.is_set() and not pulse.ended:
            return self.last.explain(why or self._describe_end())
        return RobotDisconnected(
            f"The easel's process does not answer ({error}) The robot was told to stop; look at it before going on."
        )

    def _describe_end(self) -> str:
        ended = None
        if self._process is not None:
            with contextlib.suppress(subprocess.TimeoutExpired):
                ended = self._process.wait(_HEEDING)
        if ended is None:
            return "nobody knows why"
        return f"signal {-ended}" if ended < 0 else f"exit status {ended}"

    def _answer(self, within: float, *, listen: bool) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
        now = began = time.monotonic()
        while now < began + within and not self._wire.waits(min(_LOOK_EVERY, began + within - now)):
            now = time.monotonic()
            silent = min(self.pulse.silent, now - began)
            if listen and silent > self.most_silence:
                raise RobotDisconnected(f"Nothing has been heard from it for {silent:.0f} s.")
        return self._wire.receive(max(began + within - time.monotonic(), 0.0))

    def stop(self) -> None:
        """Stops the robot at once, also during a request."""
        self.pulse.stop()

    def end(self, *, ask: bool = True) -> None:
        """Disconnects from the easel's process.

        ask: True to wait first until the process has closed everything

        Raises the errors that the process reports.
        """
        try:
            if ask and self._broken is None:
                self.ask({"do": "end"})
        finally:
            self._wire.close()
            self.pulse.end()


class RemoteRobot(Remote):
    """Robot in the easel's process: knows how long a motion may take. `make_remote` adds all other requests.

    patience, grace: see easel.guard.GuardedRobot
    """

    def __init__(self, link: Link, workspace: Workspace, *, patience: float, grace: float) -> None:
        super().__init__(lambda request, arguments: link.call(request, arguments, self._limit(request, arguments)))
        self._link, self._patience, self._grace = link, patience, grace
        self._across = np.array([workspace.lower, (*workspace.lower[:2], workspace.upper[2]), workspace.upper])
        self._travel_speed = workspace.travel_speed
        self._timing: AxisTiming | None = None
        self._held = 0.0

    def connect(self) -> None:
        """Connects to the robot. Raises RobotError and its subclasses."""
        self._ask(requests("robot")["connect"], {})
        self._timing = self._ask(requests("robot")["timing"], {})
        self._held = 0.0 if self._timing is None else _HELD

    def timing(self) -> AxisTiming | None:
        """Returns the limits that the controller told at connection; None if it told none."""
        return self._timing

    def alive_at(self) -> float:
        """Returns -inf: the easel's process watches the controller."""
        return -math.inf

    def stop(self) -> None:
        """Stops at once, over the separate line."""
        self._link.stop()

    def _limit(self, request: Request, arguments: Mapping[str, Any]) -> float | None:
        """Returns the seconds after which a request counts as unanswered; None for the link's patience."""
        match request.method:
            case "find_zero":
                return _HOMING + self._held + _MARGIN
            case "jog":
                return _CALL + self._held + _MARGIN
            case "home":
                path, speed = self._across, self._travel_speed
            case "follow":
                way: Waypoints = arguments["waypoints"]
                is_path = way.position.ndim == 2 and way.position.shape[1] == 3
                path, speed = np.concatenate([self._across, way.position]) if is_path else self._across, way.speed
            case "touch":
                path, speed = self._across, arguments["speed"]
            case _:
                return None
        seconds = motion_seconds(self._timing, path, speed) if speed > 0 else 0.0
        return seconds * self._patience + self._grace + self._held + _MARGIN


# The virtual studio replays a diary of many thousand strokes before the easel is ready.
_OPENING = 600.0
_ENDING = 30.0


class EaselProcess:
    """Process of an easel, which loads in the background; `open` returns the easel. Used in a `with` block.

    launch: process that was started before, to be taken over
    tell: receives sentences for people, such as that the stop file could not be looked for

    The end of the block disconnects the robot and ends the process, also after an exception. A process that does
    not end is killed.
    """

    def __init__(self, launch: EaselLaunch | None = None, tell: Callable[[str], None] = lambda remark: None) -> None:
        launched = (launch or EaselLaunch()).take_over()
        self._process, self._complaints = launched.process, launched.complaints
        self._wire = Wire(launched.wire)
        last = LastStop()
        self._link = Link(self._wire, Pulse(launched.line, last.engage), last, self._process, tell)
        self._opened = False

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if not self._opened:
            self._process.terminate()  # it holds nothing yet
        try:
            self._link.end(ask=self._opened)
        except FridaError:
            if error is None:
                raise
        finally:
            self._end()

    def open(self, order: EaselOrder) -> Easel:
        """Returns the ordered easel; its robot and camera are not connected yet.

        Raises RobotStopped if a person must re-arm it first, RobotBusy if another process has it, ConfigError or
        StorageError if it cannot be opened, RobotDisconnected if its process died.
        """
        try:
            self._wire.send({"order": order.record()})
            # A simulated easel may take any time; the death of its process ends the wait at once.
            about, _ = self._wire.receive(None if is_simulated(order) else _OPENING)
        except RobotDisconnected as gone:
            raise RobotDisconnected(f"The easel's process did not start{self._complaint()}.") from gone
        if "error" in about:
            raise decode_error(about)
        self._opened = True
        facts = EaselFacts.of(about["facts"])
        self._link.patience = facts.answer
        if is_simulated(order):  # a slow computer is not a fault
            self._link.most_silence = math.inf
        easel = _easel(facts, self._link)
        kind, known_as = easel_kind(order.robot), easel.calibration.easel
        alive = kind is not None and (kind.simulated or kind.person)  # nothing of it moves by itself
        self._link.last.latch = Unlatched(known_as) if alive else latch_of(order.state, known_as, about["machines"])
        return easel

    @property
    def stopped(self) -> bool:
        """True if the robot was stopped for any reason: later motions are not painted."""
        return self._link.pulse.stopped

    @contextmanager
    def hearing_signals(self) -> Iterator[None]:
        """Passes signals on to the easel's process from the system's own handler, even while Python is busy.

        Works only for signals with a handler, and in the main thread.
        """
        before = signal.set_wakeup_fd(self._link.pulse.file, warn_on_full_buffer=False)
        try:
            yield
        finally:
            signal.set_wakeup_fd(before)

    def _end(self) -> None:
        try:
            self._process.wait(_ENDING)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        self._complaints.close()

    def _complaint(self) -> str:
        """Returns the last line of the dead process's error output."""
        with contextlib.suppress(subprocess.TimeoutExpired):
            self._process.wait(5)
        self._complaints.seek(0)
        lines = self._complaints.read().decode(errors="replace").split("\n")
        return next((f" ({line})" for line in reversed(lines) if line.strip()), "")


def _easel(facts: EaselFacts, link: Link) -> Easel:
    limits = {"patience": facts.patience, "grace": facts.grace}
    return Easel(
        robot=make_remote("robot", RemoteRobot)(link, facts.workspace, **limits),
        camera=make_remote("camera")(link.call),
        operator=make_remote("operator")(link.call),
        workspace=facts.workspace,
        calibration=facts.calibration,
        canvas=facts.canvas,
        reach=make_remote("reach")(link.call) if facts.knows_reach else None,
        timing=facts.timing,
        simulated=facts.simulated,
        has_camera=facts.has_camera,
        person_brushes=facts.person_brushes,
        pace=facts.pace,
    )
