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
from typing import Any

from frida_painter.hardware.deadline import asleep, one_line, steady
from frida_painter.hardware.robot import StopLine

# The rule of the watch, without clocks or processes: when to stop a robot.
# A silent process may be dead or only slow. Therefore the rule ignores time in which the process could not send:
# while it was ready to run and no processor was free, and while the watch itself did not run. Upper bounds hold in
# any case.

LOOK_EVERY = 0.02
_WRITING = 0.5
_USUAL = 0.1  # seconds between two looks that need no explanation


@dataclass(frozen=True)
class Patience:
    """Limits of the watch's rule in seconds; infinity for no limit.

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
    slept: seconds for which the computer slept since the last look
    seen: True if somebody looked for the stop file since the last look, or need not
    """

    at: float
    moving: bool
    gone: bool = False
    thinking: bool = False
    starved: float | None = None
    slept: float = 0.0
    seen: bool = True


@dataclass
class _Span:
    """Time since a moment.

    counted: seconds of it; time in which the process or the watch could not run does not count.
    """

    since: float
    counted: float = 0.0


class SilenceRule:
    """Rule of the watch: receives heartbeats and looks in the order of time, and decides when to stop the robot."""

    def __init__(self, now: float, patience: Patience = MACHINE) -> None:
        self._patience = patience
        self._heard, self._still = _Span(now), _Span(now)  # since the last heartbeat, and since the last standstill
        self._looked, self._moved = now, False
        self._starved: float | None = None
        self._blind = 0.0

    def hear(self, at: float) -> None:
        """Records a heartbeat."""
        self._heard = _Span(at)

    def silence(self, at: float) -> float:
        """Returns the seconds since the last heartbeat."""
        return at - self._heard.since

    def judge(self, look: LinkState) -> str | None:
        """Returns the reason to stop the robot; None if there is none. Reports a reason once, then counts from 0."""
        passed, most = look.at - self._looked, self._patience
        late = max(passed - _USUAL, 0.0)
        held_up = late if self._moved else 0.0
        starved = 0.0 if look.starved is None or self._starved is None else look.starved - self._starved
        for span in (self._heard, self._still):
            span.counted += min(passed - max(late, starved), look.at - span.since)
        if not look.moving:
            self._still = _Span(look.at)
        self._looked, self._moved, self._starved = look.at, look.moving, look.starved
        self._blind = 0.0 if look.seen else self._blind + passed - late
        silent = self.silence(look.at)
        rows = (
            (look.slept > most.nap, f"the computer slept for {look.slept:.0f} s"),
            (
                held_up > most.standstill,
                f"the easel's process was held up for {held_up:.1f} s in the middle of a motion",
            ),
            (self._is_too_silent(look), f"the painting process fell silent for {silent:.1f} s"),
            (
                look.moving and self._blind > most.blind,
                f"nobody could look for the stop file for {most.blind:g} s, because its folder cannot be read",
            ),
        )
        reason = next((reason for broken, reason in rows if broken), None)
        if reason is not None:
            self._heard, self._still, self._blind = _Span(look.at), _Span(look.at), 0.0
        return reason

    def _is_too_silent(self, look: LinkState) -> bool:
        most, heard = self._patience, self._heard
        if look.moving:
            # A process that asks for a motion is alive when the motion begins.
            span = heard if heard.since >= self._still.since else self._still
            if look.gone:
                return look.at - span.since > most.orphaned
            return span.counted > most.silence or look.at - span.since > most.starved_moving
        if look.gone:
            return False  # nothing can move any more
        return look.at - heard.since > most.absence or (heard.counted > most.silence and not look.thinking)


# Bytes on the line: a heartbeat, a stop, or the number of a signal. The system's own handler writes the latter
# (signal.set_wakeup_fd), even while the painting process is busy. The other way go heartbeats, the news that the robot
# is stopped, and two messages more: LINE with a number and that many bytes, which stop the machine on the descriptor
# that comes with them (none if the line is closed), and ENDED as the last one of a process that has closed everything.
BEAT, STOP = b"\x00", b"\xff"
LINE, ENDED = b"\x01", b"\x02"
BEAT_EVERY = 0.25


class Watch:
    """Watch on the painting process: stops the robot, from a separate thread, until `dismiss`.

    line: socket that carries the bytes above
    robot: under guard (guard.GuardedRobot); the painting process gets the news of its stop, and its line
    process: painting process, for its use of processors
    patience: limits of the rule
    file: stop file, for which somebody must be able to look; None without

    After the painting process has closed its line, only a motion in progress can go on.
    """

    def __init__(
        self,
        line: socket.socket,
        robot: Any,
        process: "CpuActivity",
        patience: Patience = MACHINE,
        file: "StopFile | None" = None,
    ) -> None:
        self._line, self._robot, self._process, self._file = line, robot, process, file
        self._rule = SilenceRule(steady(), patience)
        self._lent: StopLine | None = None
        self._looks = -1
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
                self._robot.stop(f"the watch on the painting process failed ({one_line(failure)})")
                self._dismissed.wait(LOOK_EVERY)

    def _glance(self) -> None:
        if self._open:
            select.select([self._line], [], [], LOOK_EVERY)
        else:
            self._dismissed.wait(LOOK_EVERY)
        now = steady()
        slept, self._asleep = asleep() - self._asleep, asleep()
        if self._open:
            self._lend()
            self._beat(now)
            self._read(now)
        # Expensive: it looks at each thread of the process. It is needed only during a silence.
        starved = self._process.starved_seconds() if self._rule.silence(now) > 2 * BEAT_EVERY else None
        looks = self._looks if self._file is None else self._file.looks
        seen, self._looks = looks != self._looks or self._file is None, looks
        thinking, moving = self._process.thinking(), self._robot.moving
        reason = self._rule.judge(LinkState(now, moving, not self._open, thinking, starved, slept, seen))
        if reason is not None:
            self._robot.stop(reason)

    def _lend(self) -> None:
        """Sends the machine's line to the painting process, whenever it changes."""
        line = self._robot.stop_line()
        if line == self._lent or not hasattr(socket, "send_fds"):  # Windows hands no line on
            return
        content, files = (b"", []) if line is None else (line.content, [line.file])
        with contextlib.suppress(OSError):  # closed in this moment, or nobody reads: tried again at the next look
            socket.send_fds(self._line, [LINE + bytes([len(content)]) + content], files)
            self._lent = line

    def _beat(self, now: float) -> None:
        if now - self._beaten >= BEAT_EVERY:
            self._beaten = now
            with contextlib.suppress(OSError):  # the painting process is gone, or has not read for a long time
                self._line.send(BEAT if self._robot.stopped is None else STOP)

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
                self._robot.stop("the painting process asked for it")
            elif byte in (signal.SIGTERM, getattr(signal, "SIGBREAK", None)):
                self._robot.stop(f"the painting process was told to end ({signal.Signals(byte).name})")
            elif byte == signal.SIGINT:
                self._interrupts += 1
                if self._interrupts == 2:
                    self._robot.stop("Ctrl-C was pressed twice")


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
                there, failed = self._path.exists(), False
            except Exception as failure:  # whatever it is, the next look may succeed
                if not failed:
                    self._tell(f"A look for the stop file failed ({one_line(failure)}); it is tried again and again.")
                failed = True
                continue
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
    silent: seconds since the last byte of the watch; time in which this process did not run hardly counts
    """

    def __init__(self, line: socket.socket, vanished: Callable[[bool], None] = lambda held: None) -> None:
        self._line, self._vanished = line, vanished
        self._line.setblocking(False)
        self.silent, self._stopped, self.ended = 0.0, False, False
        self.gone = threading.Event()
        self._over = threading.Event()
        self._rest, self._files = b"", list[int]()
        self._lent: StopLine | None = None
        self._thread = threading.Thread(target=self._keep, name="heartbeat", daemon=True)
        self._thread.start()

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
            self.silent = 0.0 if heard else self.silent + min(now - looked, 2 * BEAT_EVERY)
            looked = now
            if self.gone.is_set():
                return

    def _hear(self) -> bool:
        """Waits for a moment; returns True if anything came."""
        try:
            if not select.select([self._line], [], [], BEAT_EVERY)[0]:
                return False
            hears = hasattr(socket, "recv_fds")
            content, files, *_ = socket.recv_fds(self._line, 4096, 8) if hears else (self._line.recv(4096), [])
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


class CpuActivity:
    """Activity of the process `pid`. On systems without /proc it neither computes nor waits."""

    def __init__(self, pid: int) -> None:
        self._place = Path(f"/proc/{pid}")
        self._at, self._used = steady(), self._processor_seconds()
        self._busy = False
        self._counted_at, self._starved = steady(), 0.0
        self._threads: dict[str, tuple[int, int]] = {}

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
            self._starved += self._longest_wait(now - self._counted_at)
            self._counted_at = now
        return self._starved

    def _longest_wait(self, passed: float) -> float:
        """Returns the seconds of the longest wait of a thread since the last call, `passed` seconds ago.

        The system counts a wait only when it ends. A thread that is ready, but did not run, waited all the time.
        """
        before, self._threads, longest = self._threads, {}, 0.0
        with contextlib.suppress(OSError):
            for task in (self._place / "task").iterdir():
                try:
                    state, _ = _state_and_ticks(task / "stat")
                    ran, delayed, *_ = map(int, (task / "schedstat").read_text().split())
                except (OSError, ValueError, IndexError):
                    continue  # the thread has ended, or the system does not count
                self._threads[task.name] = ran, delayed
                if task.name in before:
                    ran_before, delayed_before = before[task.name]
                    waits = state == "R" and ran == ran_before
                    longest = max(longest, passed if waits else (delayed - delayed_before) / 1e9)
        return min(longest, passed)

    def _processor_seconds(self) -> float:
        """Returns the total processor seconds of the process."""
        try:
            return _state_and_ticks(self._place / "stat")[1] / os.sysconf("SC_CLK_TCK")
        except (AttributeError, OSError, ValueError, IndexError):
            return 0.0


def _state_and_ticks(stat: Path) -> tuple[str, int]:
    """Returns the state letter of a process or thread, and its processor ticks."""
    fields = stat.read_text().rpartition(")")[2].split()  # the name in parentheses may contain anything
    return fields[0], int(fields[11]) + int(fields[12])
