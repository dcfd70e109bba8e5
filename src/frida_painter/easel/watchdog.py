"""The watch beside a robot: stop asked for on a line of its own, a stop file, and a painting process that falls silent.

Nothing here waits for a motion, a message or the painting process. Whatever touches the disk, and so
may wait for it, has a thread of its own.
"""

import contextlib
import math
import os
import select
import signal
import socket
import threading
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from frida_painter.hardware.deadline import asleep, steady

# When a robot is stopped because its painting process fell silent: the rule alone, without clocks or processes.
#
# A silent process may be dead, or merely slow. The rule therefore does not count time in which the process
# could not have spoken: time in which it was ready to run and no processor was free, and time in which the
# watch itself did not run. Upper bounds hold whatever the reason.

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


# What comes over the line, one byte each: a heartbeat, a stop, or the number of a signal, which the
# system's own handler writes there (signal.set_wakeup_fd) whatever the painting process is doing.
BEAT, STOP = b"\x00", b"\xff"
BEAT_EVERY = 0.25


class Process(Protocol):
    """What is seen of the painting process from outside."""

    def thinking(self) -> bool:
        """Whether it took processor time of late."""
        ...

    def starved(self) -> float:
        """Seconds so far in which it was ready to run and no processor was free."""
        ...


class Watch:
    """Stops the robot by `stop(reason)`, from a thread of its own, until `dismiss`.

    line: bytes as above come over it. A silence that is longer than `patience` allows stops the robot, as
    silence.py tells, and so does a computer that slept. Once the line was closed (the painting process
    ended), nothing can move any more but what moves already. stopped: whether the robot stands still for whatever
    reason, which the heartbeats tell the painting process.
    """

    def __init__(
        self,
        line: socket.socket,
        stop: Callable[[str], None],
        moving: Callable[[], bool],
        process: Process,
        patience: Patience = MACHINE,
        *,
        stopped: Callable[[], bool] = lambda: False,
    ) -> None:
        self._stopped = stopped
        self._line, self._stop, self._moving, self._process = line, stop, moving, process
        self._nap = patience.nap
        self._rule = SilenceRule(steady(), patience)
        self._asleep, self._beaten = asleep(), -math.inf
        self._interrupts = 0
        self._open = True
        self._dismissed = threading.Event()
        self._line.setblocking(False)
        self._thread = threading.Thread(target=self._keep, name="watch", daemon=True)
        self._thread.start()

    def dismiss(self) -> None:
        """Ends the watch."""
        self._dismissed.set()
        self._thread.join()

    def _keep(self) -> None:
        while not self._dismissed.is_set():
            if self._open:
                select.select([self._line], [], [], LOOK_EVERY)
            else:
                self._dismissed.wait(LOOK_EVERY)
            now = steady()
            # Before anything is read: what was sent before the computer slept says nothing of now.
            slept, self._asleep = asleep() - self._asleep, asleep()
            if slept > self._nap:
                self._stop(f"the computer slept for {slept:.0f} s")
            if self._open:
                self._beat(now)
                self._read(now)
            if reason := self._rule.judge(self._look(now)):
                self._stop(reason)

    def _beat(self, now: float) -> None:
        if now - self._beaten >= BEAT_EVERY:
            self._beaten = now
            with contextlib.suppress(OSError):  # the painting process is gone, or has not read for long
                self._line.send(STOP if self._stopped() else BEAT)

    def _look(self, now: float) -> LinkState:
        thinking = self._process.thinking()
        # What it waited for is asked of each of its threads, and of no use while it is heard.
        starved = self._process.starved() if self._rule.silence(now) > 2 * BEAT_EVERY else None
        return LinkState(now, self._moving(), not self._open, thinking, starved)

    def _read(self, now: float) -> None:
        try:
            content = self._line.recv(4096)
        except BlockingIOError:
            return
        except OSError:
            content = b""
        if not content:
            self._open = False
        for byte in content:
            if byte == BEAT[0]:
                self._rule.hear(now)
            elif byte == STOP[0]:
                self._stop("the painting process asked for it")
            elif byte == signal.SIGTERM:
                self._stop("the painting process was told to end (SIGTERM)")
            elif byte == signal.SIGINT:
                self._interrupts += 1
                if self._interrupts == 2:
                    self._stop("Ctrl-C was pressed twice")


class StopFile:
    """Stops the robot when a file appears, and takes the file away; until `dismiss`."""

    def __init__(self, path: Path, stop: Callable[[str], None]) -> None:
        self._path, self._stop = path, stop
        self._dismissed = threading.Event()
        threading.Thread(target=self._keep, name="stop file", daemon=True).start()

    def dismiss(self) -> None:
        """Ends the watch."""
        self._dismissed.set()

    def _keep(self) -> None:
        while not self._dismissed.wait(LOOK_EVERY):
            if self._path.exists():
                self._stop(f"the stop file {self._path.name} appeared")
                # Where it cannot be taken away it stops the next painting in this folder as well.
                with contextlib.suppress(OSError):
                    self._path.unlink()
                return


class Pulse:
    """The painting process's end of the line: sends and hears heartbeats on a thread of its own; stops when asked.

    file: the line's file number, for signal.set_wakeup_fd.
    """

    def __init__(self, line: socket.socket) -> None:
        self._line = line
        self._line.setblocking(False)
        self._silent, self._stopped = 0.0, False
        self._ended = threading.Event()
        threading.Thread(target=self._beat, name="heartbeat", daemon=True).start()

    @property
    def file(self) -> int:
        """The line's file number."""
        return self._line.fileno()

    @property
    def silent(self) -> float:
        """Seconds since the watch was heard; of a time in which this process did not run, next to nothing counts."""
        return self._silent

    @property
    def stopped(self) -> bool:
        """Whether the watch has told that the robot was stopped, for whatever reason, and stays so."""
        return self._stopped

    def stop(self) -> None:
        """Has the robot stopped at once."""
        self._send(STOP)

    def end(self) -> None:
        """Closes the line."""
        self._ended.set()
        self._line.close()

    def _beat(self) -> None:
        self._send(BEAT)
        looked = steady()
        while not self._ended.wait(BEAT_EVERY):
            self._send(BEAT)
            now = steady()
            self._silent = 0.0 if self._heard() else self._silent + min(now - looked, 2 * BEAT_EVERY)
            looked = now

    def _heard(self) -> bool:
        """Whether anything came since this was asked before."""
        try:
            content = self._line.recv(4096)
        except OSError:
            return False
        self._stopped = self._stopped or STOP in content
        return bool(content)

    def _send(self, byte: bytes) -> None:
        with contextlib.suppress(OSError):  # nobody listens any more, or the line is full of heartbeats
            self._line.send(byte)


# Whether a process computes, stands still, or waits for a processor: by what the system counts of its threads.

_LOOK_EVERY = 0.5  # seconds
_BUSY = 0.02  # of that time on a processor; a process that was stopped, or hangs, takes none
_COUNT_EVERY = 0.1
_READY = "R"


class CpuActivity:
    """Of the process of that number; where the system does not tell (Linux does), it neither computes nor waits."""

    def __init__(self, pid: int) -> None:
        self._place = Path(f"/proc/{pid}")
        self._at, self._used = steady(), self._taken()
        self._busy = False
        self._counted_at, self._starved = steady(), 0.0
        self._threads: dict[str, _Thread] = {}

    def thinking(self) -> bool:
        """Whether it was busy in the last second; to be asked often."""
        now = steady()
        if now - self._at >= _LOOK_EVERY:
            used = self._taken()
            self._busy = used - self._used >= _BUSY * (now - self._at)
            self._at, self._used = now, used
        return self._busy

    def starved(self) -> float:
        """Seconds so far in which a thread of it was ready to run and no processor was free.

        Only the difference of two answers means anything, and only where it was asked often in between.
        """
        now = steady()
        if now - self._counted_at >= _COUNT_EVERY:
            waited = self._waited(now)
            self._starved += min(waited, now - self._counted_at)
            self._counted_at = now
        return self._starved

    def _waited(self, now: float) -> float:
        """Seconds that the thread which waited longest has waited since this was asked before."""
        threads: dict[str, _Thread] = {}
        longest = 0.0
        try:
            tasks = list((self._place / "task").iterdir())
        except OSError:
            tasks = []
        for task in tasks:
            try:
                state, _ = _state_and_ticks(task / "stat")
                ran, delayed, *_ = map(int, (task / "schedstat").read_text().split())
            except (OSError, ValueError, IndexError):
                continue  # it has ended meanwhile, or the system does not count
            before = self._threads.get(task.name)
            threads[task.name] = after = _Thread.after(before, now, state, ran, delayed / 1e9)
            if before is not None:
                longest = max(longest, after.waited - before.waited)
        self._threads = threads
        return longest

    def _taken(self) -> float:
        """Seconds of all processors that it has taken so far."""
        try:
            return _state_and_ticks(self._place / "stat")[1] / os.sysconf("SC_CLK_TCK")
        except (OSError, ValueError, IndexError):
            return 0.0


@dataclass(frozen=True)
class _Thread:
    """What was counted of a thread; changed: when the counts last moved; waited: seconds, the wait under way included.

    The system counts a wait when it ends, so that one that lasts is seen by a thread that is ready and does not run.
    """

    ran: int
    delayed: float
    changed: float
    waited: float

    @classmethod
    def after(cls, before: "_Thread | None", now: float, state: str, ran: int, delayed: float) -> "_Thread":
        if before is None:
            return cls(ran, delayed, now, delayed)
        moved = state != _READY or (ran, delayed) != (before.ran, before.delayed)
        changed = now if moved else before.changed
        return cls(ran, delayed, changed, max(before.waited, delayed + now - changed))


def _state_and_ticks(stat: Path) -> tuple[str, int]:
    """The state letter of a process or thread, and the ticks of processors that it has taken."""
    fields = stat.read_text().rpartition(")")[2].split()  # its name may hold anything
    return fields[0], int(fields[11]) + int(fields[12])
