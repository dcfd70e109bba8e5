"""The watchdog of a robot: stops it on request, because of a stop file, or if the painting process falls silent.

Nothing here waits for a motion, a message or the painting process. Disk access may block, and therefore has
separate threads.
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

from frida_painter.hardware.deadline import asleep, one_line, steady
from frida_painter.hardware.robot import StopLine

# The silence rule, without clocks or processes: when to stop a robot because its painting process is silent.
# A silent process may be dead or only slow. Therefore the rule ignores time in which the process could not send:
# while it was ready to run and no processor was free, and while the watch itself did not run. Upper bounds hold in
# any case.

LOOK_EVERY = 0.02
_WRITING = 0.5
_USUAL = 0.1  # seconds between two looks that need no explanation


@dataclass(frozen=True)
class Patience:
    """Limits of the silence rule in seconds; infinity for no limit.

    silence: silence that counts, before the robot is stopped
    starved_moving: silence of any kind, during a motion
    absence: silence of any kind, without a motion; also of a process that computes
    standstill: pause of the watch itself, during a motion
    nap: sleep of the computer
    orphaned: silence during a motion after the painting process is gone
    blind: time during a motion in which nobody could look for the stop file
    """

    silence: float = 2.5
    starved_moving: float = 10.0
    absence: float = 30.0
    standstill: float = 3.0
    nap: float = 1.0
    orphaned: float = 2.5
    blind: float = 2.0


# A robot stops within 3 s of silence; half a second of that is for the stop itself.
MACHINE = Patience()
# A simulated robot hurts nobody: its painting process may be silent for as long as it exists.
SIMULATED = Patience(
    silence=math.inf, starved_moving=math.inf, absence=math.inf, standstill=math.inf, nap=math.inf, blind=math.inf
)


@dataclass(frozen=True)
class LinkState:
    """State of the link at one moment.

    at: seconds
    moving: True during a motion
    gone: True if the painting process closed its line
    thinking: True if the process used processor time recently
    starved: total seconds in which the process was ready to run without a free processor; None if not measured
    """

    at: float
    moving: bool
    gone: bool = False
    thinking: bool = False
    starved: float | None = None


class SilenceRule:
    """Silence rule: receives heartbeats and looks in the order of time, and decides when to stop the robot."""

    def __init__(self, now: float, patience: Patience = MACHINE) -> None:
        self._patience = patience
        self._heard = self._still = _Span(now)
        self._looked, self._moved = now, False

    def hear(self, at: float) -> None:
        """Records a heartbeat."""
        self._heard = _Span(at)

    def silence(self, at: float) -> float:
        """Returns the seconds since the last heartbeat."""
        return at - self._heard.since

    def judge(self, look: LinkState) -> str | None:
        """Returns the reason to stop the robot; None if there is none. Reports a silence once, then counts from 0."""
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
            # A process that asks for a motion is alive when the motion begins.
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
    """Time since a moment, with the part of it in which the process could not send."""

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
        """Returns the seconds that count: without those in which the process, or the watch, had no processor."""
        return look.at - self.since - max(0.0 if look.gone else self._starved, self._late)


# Bytes on the line: a heartbeat, a stop, or the number of a signal. The system's own handler writes the latter
# (signal.set_wakeup_fd), even while the painting process is busy. The other way go heartbeats, the news that the robot
# is stopped, and two messages more: LINE with a number and that many bytes, which stop the machine on the descriptor
# that comes with them (none if the line is closed), and ENDED as the last one of a process that has closed everything.
BEAT, STOP = b"\x00", b"\xff"
LINE, ENDED = b"\x01", b"\x02"
BEAT_EVERY = 0.25


class Process(Protocol):
    """Painting process as seen from outside."""

    def thinking(self) -> bool:
        """Returns True if it used processor time recently."""
        ...

    def starved_seconds(self) -> float:
        """Returns the total seconds in which it was ready to run and no processor was free."""
        ...


class Watch:
    """Watch on the painting process: stops the robot by `stop(reason)`, from a separate thread, until `dismiss`.

    line: socket that carries the bytes above
    moving: returns True during a motion
    process: painting process, for its use of processors
    patience: limits of the silence rule
    stopped: returns True if the robot is stopped for any reason; the heartbeats tell it to the painting process
    stop_line: returns the line over which the painting process can stop the machine if this one is gone
    looked: returns how often somebody has looked for the stop file

    Sleep of the computer stops the robot too. After the painting process has closed its line, only a motion in
    progress can go on.
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
        stop_line: Callable[[], StopLine | None] = lambda: None,
        looked: Callable[[], int] | None = None,
    ) -> None:
        self._stopped, self._stop_line, self._looked = stopped, stop_line, looked
        self._lent: StopLine | None = None
        self._looks, self._blind, self._at, self._most_blind = -1, 0.0, steady(), patience.blind
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
            try:
                self._glance()
            except Exception as failure:  # whatever it is: nobody watches then, and that must not be silent
                self._stop(f"the watch on the painting process failed ({one_line(failure)})")
                self._dismissed.wait(LOOK_EVERY)

    def _glance(self) -> None:
        if self._open:
            select.select([self._line], [], [], LOOK_EVERY)
        else:
            self._dismissed.wait(LOOK_EVERY)
        now = steady()
        # Before reading: bytes from before the computer's sleep say nothing about now.
        slept, self._asleep = asleep() - self._asleep, asleep()
        if slept > self._nap:
            self._stop(f"the computer slept for {slept:.0f} s")
        if self._open:
            self._lend()
            self._beat(now)
            self._read(now)
        look = self._look(now)
        if reason := self._rule.judge(look) or self._judge_sight(look):
            self._stop(reason)

    def _judge_sight(self, look: LinkState) -> str | None:
        """Returns the reason to stop a robot that moves while nobody can look for the stop file. Told once."""
        looks = self._looks if self._looked is None else self._looked()
        # Time in which this thread did not run is not counted: the other thread may not have run either.
        passed, self._at = min(look.at - self._at, _USUAL), look.at
        seen, self._looks = looks != self._looks or self._looked is None, looks
        self._blind = 0.0 if seen else self._blind + passed
        if not look.moving or not self._blind > self._most_blind:
            return None
        self._blind = 0.0
        return f"nobody could look for the stop file for {self._most_blind:g} s, because its folder cannot be read"

    def _lend(self) -> None:
        """Sends the machine's line to the painting process, whenever it changes."""
        line = self._stop_line()
        if line == self._lent:
            return
        content, files = (b"", []) if line is None else (line.content, [line.file])
        with contextlib.suppress(OSError):  # closed in this moment, or nobody reads: tried again at the next look
            socket.send_fds(self._line, [LINE + bytes([len(content)]) + content], files)
            self._lent = line

    def _beat(self, now: float) -> None:
        if now - self._beaten >= BEAT_EVERY:
            self._beaten = now
            with contextlib.suppress(OSError):  # the painting process is gone, or has not read for a long time
                self._line.send(STOP if self._stopped() else BEAT)

    def _look(self, now: float) -> LinkState:
        thinking = self._process.thinking()
        # Expensive: it looks at each thread of the process. It is needed only during a silence.
        starved = self._process.starved_seconds() if self._rule.silence(now) > 2 * BEAT_EVERY else None
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
    """Watch on a stop file: stops the robot when the file appears and deletes the file, until `dismiss`.

    A look that fails, for example because a network folder is away for a moment, is told once and tried again.

    looks: number of looks that did not fail; a look may also hang, so somebody else must count (Watch)
    """

    def __init__(
        self, path: Path, stop: Callable[[str], None], tell: Callable[[str], None] = lambda remark: None
    ) -> None:
        self._path, self._stop, self._tell = path, stop, tell
        self.looks = 0
        self._dismissed = threading.Event()
        threading.Thread(target=self._keep, name="stop file", daemon=True).start()

    def dismiss(self) -> None:
        """Ends the watch."""
        self._dismissed.set()

    def _keep(self) -> None:
        failed = False
        while not self._dismissed.wait(LOOK_EVERY):
            try:
                there = self._path.exists()
            except Exception as failure:  # whatever it is, the next look may succeed
                if not failed:
                    self._tell(f"A look for the stop file failed ({one_line(failure)}); it is tried again and again.")
                failed = True
                continue
            failed = False
            self.looks += 1
            if there:
                self._stop(f"the stop file {self._path.name} appeared")
                # A file that cannot be deleted also stops the next painting in this folder.
                with contextlib.suppress(OSError):
                    self._path.unlink()
                return


class Pulse:
    """Painting process's end of the line: exchanges heartbeats in a separate thread, and sends stops.

    vanished: called in that thread if the easel's process is gone without a last word; it gets True if its machine got
        a stop over its own line

    gone: set when the other end is closed, after `vanished`
    ended: True if the other process had closed everything before
    """

    def __init__(self, line: socket.socket, vanished: Callable[[bool], None] = lambda held: None) -> None:
        self._line, self._vanished = line, vanished
        self._line.setblocking(False)
        self._silent, self._stopped, self.ended = 0.0, False, False
        self.gone = threading.Event()
        self._over = threading.Event()
        self._rest, self._files = b"", list[int]()
        self._lent: StopLine | None = None
        self._thread = threading.Thread(target=self._keep, name="heartbeat", daemon=True)
        self._thread.start()

    @property
    def file(self) -> int:
        """File number of the line, for signal.set_wakeup_fd."""
        return self._line.fileno()

    @property
    def silent(self) -> float:
        """Seconds since the last byte of the watch. Time in which this process did not run hardly counts."""
        return self._silent

    @property
    def stopped(self) -> bool:
        """True if the watch reported that the robot was stopped for any reason, or its process vanished; stays True."""
        return self._stopped or (self.gone.is_set() and not self.ended)

    def stop(self) -> None:
        """Makes the watch stop the robot at once."""
        self._send(STOP)

    def end(self) -> None:
        """Closes the line."""
        self._over.set()
        with contextlib.suppress(OSError):
            self._line.shutdown(socket.SHUT_RDWR)  # wakes the thread
        self._thread.join(2 * BEAT_EVERY)
        self._line.close()
        self._give_back()

    def _keep(self) -> None:
        looked, sent = steady(), -math.inf
        while not self._over.is_set():
            if steady() - sent >= BEAT_EVERY:
                self._send(BEAT)
                sent = steady()
            heard = self._hear()
            now = steady()
            self._silent = 0.0 if heard else self._silent + min(now - looked, 2 * BEAT_EVERY)
            looked = now
            if self.gone.is_set():
                return

    def _hear(self) -> bool:
        """Waits for a moment; returns True if anything came."""
        try:
            if not select.select([self._line], [], [], BEAT_EVERY)[0]:
                return False
            content, files, *_ = socket.recv_fds(self._line, 4096, 8)
        except BlockingIOError:
            return False
        except (OSError, ValueError):  # the other end died with bytes unread, or this one was closed
            content, files = b"", []
        for file in files:
            os.set_inheritable(file, False)
        self._files += files
        if content:
            self._take(self._rest + content)
        elif not self._over.is_set():
            self._lose()
        return bool(content)

    def _take(self, content: bytes) -> None:
        while content:
            kind = content[:1]
            if kind == LINE:
                end = 2 + content[1] if len(content) > 1 else 2
                if len(content) < end:
                    break
                self._give_back()
                self._lent = StopLine(self._files.pop(0), content[2:end]) if end > 2 and self._files else None
                content = content[end:]
                continue
            self._stopped = self._stopped or kind == STOP
            self.ended = self.ended or kind == ENDED
            content = content[1:]
        self._rest = content

    def _lose(self) -> None:
        """Stops the machine of a process that vanished, as far as its line is known, and tells it."""
        if not self.ended:
            self._vanished(self._lent is not None and _write_whole(self._lent))
        self.gone.set()

    def _give_back(self) -> None:
        lent, self._lent = self._lent, None
        if lent is not None:
            with contextlib.suppress(OSError):
                os.close(lent.file)

    def _send(self, byte: bytes) -> None:
        with contextlib.suppress(OSError):  # nobody listens any more, or the line is full of heartbeats
            self._line.send(byte)


def _write_whole(line: StopLine) -> bool:
    """Writes the bytes that stop a machine to its line; returns True if the system took them all in time."""
    content, until = line.content, steady() + _WRITING
    try:
        os.set_blocking(line.file, False)
        while content and steady() < until:
            select.select([], [line.file], [], LOOK_EVERY)
            with contextlib.suppress(BlockingIOError):
                content = content[os.write(line.file, content) :]
    except OSError:
        return False
    return not content


# Activity of a process: computing, idle or waiting for a processor, from the system's counters of its threads.

_LOOK_EVERY = 0.5  # seconds
_BUSY = 0.02  # share of that time on a processor; a stopped or hung process uses none
_COUNT_EVERY = 0.1
_READY = "R"


class CpuActivity:
    """Activity of the process `pid`. On systems without /proc it neither computes nor waits."""

    def __init__(self, pid: int) -> None:
        self._place = Path(f"/proc/{pid}")
        self._at, self._used = steady(), self._processor_seconds()
        self._busy = False
        self._counted_at, self._starved = steady(), 0.0
        self._threads: dict[str, _Thread] = {}

    def thinking(self) -> bool:
        """Returns True if it was busy in the last second; must be called often."""
        now = steady()
        if now - self._at >= _LOOK_EVERY:
            used = self._processor_seconds()
            self._busy = used - self._used >= _BUSY * (now - self._at)
            self._at, self._used = now, used
        return self._busy

    def starved_seconds(self) -> float:
        """Returns the total seconds in which one of its threads was ready to run without a free processor.

        Only the difference of two results is meaningful, and only with frequent calls in between.
        """
        now = steady()
        if now - self._counted_at >= _COUNT_EVERY:
            waited = self._longest_wait(now)
            self._starved += min(waited, now - self._counted_at)
            self._counted_at = now
        return self._starved

    def _longest_wait(self, now: float) -> float:
        """Returns the seconds of the longest wait of a thread since the last call."""
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
                continue  # the thread has ended, or the system does not count
            before = self._threads.get(task.name)
            threads[task.name] = after = _Thread.after(before, now, state, ran, delayed / 1e9)
            if before is not None:
                longest = max(longest, after.waited - before.waited)
        self._threads = threads
        return longest

    def _processor_seconds(self) -> float:
        """Returns the total processor seconds of the process."""
        try:
            return _state_and_ticks(self._place / "stat")[1] / os.sysconf("SC_CLK_TCK")
        except (OSError, ValueError, IndexError):
            return 0.0


@dataclass(frozen=True)
class _Thread:
    """Counters of a thread.

    ran: its time on a processor, as the system counts it
    delayed: seconds of its completed waits
    changed: time of the last change of the counters
    waited: seconds of all waits, including the current one

    The system counts a wait only when it ends. A thread that is ready, but whose counters stand still, is in a
    wait.
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
    """Returns the state letter of a process or thread, and its processor ticks."""
    fields = stat.read_text().rpartition(")")[2].split()  # the name in parentheses may contain anything
    return fields[0], int(fields[11]) + int(fields[12])
