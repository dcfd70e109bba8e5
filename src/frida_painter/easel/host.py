"""The easel's process: owns robot and camera, and answers the painting process's requests one after another.

A request names a part of the easel and its task. The answer contains the result, or the class and the message of a
FridaError.
"""

import contextlib
import os
import signal
import socket
import sys
import threading
from collections import deque
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from types import FrameType, TracebackType
from typing import Any, NoReturn

import cv2
import numpy as np
import torch
from filelock import FileLock, Timeout
from numpy.typing import NDArray
from pydantic import TypeAdapter

from frida_painter import storage
from frida_painter.calibration import Calibration
from frida_painter.canvas_size import CanvasSize
from frida_painter.devices import prepare_process
from frida_painter.easel.guard import GuardedCamera, GuardedRobot
from frida_painter.easel.kinds import LIVE_PICTURE, STOP_FILE
from frida_painter.easel.open import is_simulated, load_easel, lock_path, machines, open_easel
from frida_painter.easel.order import EaselOrder
from frida_painter.easel.watchdog import ENDED, MACHINE, SIMULATED, STOP, CpuActivity, StopFile, Watch
from frida_painter.easel.wire import Wire
from frida_painter.errors import FridaError, MotionFailed, RobotBusy, RobotDisconnected, RobotError, RobotStopped
from frida_painter.hardware.deadline import one_line
from frida_painter.hardware.easel import Easel, Operator, PersonBrush, PersonCanvas, PersonStroke
from frida_painter.hardware.latch import HOW_TO_ARM, Unlatched, latch_of
from frida_painter.hardware.robot import (
    Camera,
    LimitedRobot,
    LiveCamera,
    MotionReport,
    PausableRobot,
    Reach,
    Robot,
    TimedRobot,
    Waypoints,
    Workspace,
    Zero,
    ZeroedRobot,
)
from frida_painter.hardware.timing import AxisTiming, Timing
from frida_painter.hardware.travel import TravelLimits
from frida_painter.palette import Palette

# One robot, one process: a lock that the system releases when its process ends for any reason.


class RobotLock:
    """Lock on a robot, held by this process until `release`.

    Raises RobotBusy, with the id of the process that holds it, or StorageError if the file cannot be created.
    The file remains, with the id of the last process that held the lock. The lock of a dead process is free.
    """

    def __init__(self, path: Path, robot: str) -> None:
        # Only a lock of the system will do: a marker file would outlive a process that dies.
        self._lock = FileLock(
            path, mode=0o644, fallback_to_soft=False, preserve_lock_file=True, thread_local=False, on_acquired=_sign
        )
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            self._lock.acquire(blocking=False)
        except Timeout as error:
            holder = _process(path)
            whose = f"process {holder}" if holder else "another process"
            raise RobotBusy(
                f"{robot} is in use by {whose}; wait until that painting is done, or stop it first.", holder
            ) from error
        except OSError as error:
            raise storage.cannot_write(path, error) from error

    def release(self) -> None:
        """Releases the lock."""
        self._lock.release()


def _sign(file: int) -> None:
    with contextlib.suppress(OSError):  # the lock holds without the process id, too
        os.ftruncate(file, 0)
        os.pwrite(file, str(os.getpid()).encode(), 0)


def _process(path: Path) -> int | None:
    """Returns the process id in a lock file; None if there is none (yet)."""
    try:
        with path.open("rb") as file:
            text = file.read(20)
    except OSError:
        return None
    return int(text) if text.isdigit() else None


Answer = tuple[dict[str, Any], dict[str, NDArray[Any]]]


@dataclass(frozen=True)
class Host:
    """Server of an easel over a wire, with guarded robot and camera.

    reach: of the robot's arm, None if it is not asked for
    remarks: sentences for people, which go with the next answer
    """

    robot: Robot
    camera: Camera
    operator: Operator
    reach: Reach | None = None
    remarks: deque[str] = field(default_factory=deque)

    def serve(self, wire: Wire) -> bool:
        """Answers requests until the painting process asks for the end. That request is left for the caller to answer.

        Returns True if the end was asked for, False if the painting process is gone.
        """
        try:
            while True:
                words, arrays = wire.receive()
                if words.get("do") == "end":
                    return True
                answer, result = self._answer(words, arrays)
                told = [self.remarks.popleft() for _ in range(len(self.remarks))]
                wire.send({**answer, "remarks": told} if told else answer, result)
        except RobotDisconnected:
            return False

    def _answer(self, words: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]]) -> Answer:
        try:
            return self._do(words, arrays)
        except FridaError as error:
            return encode_error(error), {}
        except Exception as error:  # also of our own code: the painting process must hear of it
            return encode_error(RobotError(f"The easel's process could not do {words.get('do')!r} ({error!r}).")), {}

    def _do(self, words: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]]) -> Answer:
        robot, camera, operator = self.robot, self.camera, self.operator
        match words.get("do"):
            case "robot.connect":
                robot.connect()
                return self._told(), {}
            case "robot.zero":
                return _zero(robot), {}
            case "robot.find_zero" if isinstance(robot, ZeroedRobot):
                robot.find_zero()
            case "robot.jog" if isinstance(robot, ZeroedRobot):
                robot.jog(arrays["step"])
            case "robot.set_zero" if isinstance(robot, ZeroedRobot):
                robot.set_zero(arrays["tip"])
            case "robot.travel_limits":
                told = robot.travel_limits() if isinstance(robot, LimitedRobot) else None
                return {"limits": TypeAdapter(TravelLimits | None).dump_python(told)}, {}
            case "robot.wants_pause":
                return {"wanted": isinstance(robot, PausableRobot) and robot.wants_pause()}, {}
            case "robot.home":
                return _report(robot.home())
            case "robot.pose":
                return {}, {"pose": robot.pose()}
            case "robot.follow":
                cue = None if words.get("cue") is None else (str(words["cue"][0]), str(words["cue"][1]))
                way = Waypoints(str(words["label"]), arrays["position"], float(words["speed"]), cue)
                return _report(robot.follow(way))
            case "robot.feels":
                return {"feels": robot.feels() if isinstance(robot, GuardedRobot) else None}, {}
            case "robot.touch" if isinstance(robot, GuardedRobot):
                return _report(robot.touch(float(words["lowest"]), float(words["speed"])))
            case "robot.close":
                robot.close()
            case "robot.reaches" if self.reach is not None:
                found = self.reach.reachable(arrays["position"])
                return {}, {"reachable": found.astype(np.uint8)}
            case "camera.connect":
                camera.connect()
            case "camera.capture":
                frame = camera.capture(float(words["newer_than"]))
                return {"captured_at": frame.captured_at, "sequence": frame.sequence}, {"image": frame.image}
            case "camera.close":
                camera.close()
            case "operator.fill_wells":
                operator.fill_wells(Palette(torch.from_numpy(arrays["color"])))
            case "operator.tone":
                red, green, blue = map(float, words["ground"])
                operator.tone((red, green, blue))
            case "operator.change_brush":
                operator.change_brush(str(words["brush"]))
            case "operator.let_dry":
                operator.let_dry(words["seconds"])
            case "operator.paint_stroke" if isinstance(operator, PersonCanvas):
                operator.paint_stroke(PersonStroke.of(words["stroke"]))
            case "operator.lay_paper":
                return {"done": operator.lay_paper()}, {}
            case "operator.lay_checker":
                return {"done": operator.lay_checker()}, {}
            case "operator.take_checker_away":
                return {"done": operator.take_checker_away()}, {}
            case unknown:
                raise RobotError(f"The easel's process was asked for {unknown!r}, which it does not know.")
        return {}, {}

    def _told(self) -> dict[str, Any]:
        """Returns what a connected robot's controller told, as plain values."""
        timing = self.robot.timing() if isinstance(self.robot, TimedRobot) else None
        machines = sorted(self.robot.latch.machines) if isinstance(self.robot, GuardedRobot) else []
        return {"timing": TypeAdapter(AxisTiming | None).dump_python(timing, mode="json"), "machines": machines}


def _zero(robot: Robot) -> dict[str, Any]:
    zero = robot.zero() if isinstance(robot, ZeroedRobot) else Zero()
    return {"lost": zero.lost, "homes": zero.homes}


def encode_error(error: FridaError) -> dict[str, Any]:
    """Returns an error as plain values for the other end, which converts it back with `decode_error`."""
    details: dict[str, Any] = {}
    if isinstance(error, RobotBusy):
        details = {"pid": error.pid}
    elif isinstance(error, MotionFailed):
        details = {"code": error.code, "waypoint": error.waypoint}
    elif isinstance(error, RobotStopped):
        details = {"asked": error.asked}
    return {"error": type(error).__name__, "message": str(error), "details": details}


def _report(report: MotionReport) -> Answer:
    times = {"label": report.label, "started_at": report.started_at, "finished_at": report.finished_at}
    return times, {"reached": np.asarray(report.reached, np.float64)}


# The live picture: the camera's current picture in a file, renewed about once a second, for people to watch.

BETWEEN = 1.0
"""Seconds between two pictures."""
_WIDEST, _QUALITY = 960, 75
_LAST = 2.0  # seconds of patience with a picture that is being written


class LivePicture:
    """Live picture: a JPEG at `path`, renewed until `dismiss`. A camera that is not live has none.

    It has no priority: the painter's photographs come first, and a picture that cannot be taken or written is
    skipped.
    """

    def __init__(self, camera: GuardedCamera, path: Path, between: float = BETWEEN) -> None:
        self._camera, self._path, self._between = camera, path, between
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True, name="live picture")
        if isinstance(camera.camera, LiveCamera):
            self._thread.start()

    def dismiss(self) -> None:
        """Ends the live picture and removes the file."""
        self._over.set()
        if self._thread.is_alive():
            self._thread.join(_LAST)
        self._path.unlink(missing_ok=True)

    def _run(self) -> None:
        while not self._over.wait(self._between):
            try:
                picture = self._camera.glance()
                if picture is not None:
                    storage.write_bytes(self._path, encode_jpeg(picture))
            except Exception:  # whatever it is, the next picture may succeed
                continue
        self._path.unlink(missing_ok=True)  # a picture that came late


def encode_jpeg(picture: NDArray[np.uint8]) -> bytes:
    """Returns a picture [rows, columns, 3] sRGB as JPEG, at most 960 pixels wide."""
    share = min(1.0, _WIDEST / picture.shape[1])
    small = cv2.resize(picture, None, fx=share, fy=share, interpolation=cv2.INTER_AREA) if share < 1 else picture
    _, content = cv2.imencode(".jpg", cv2.cvtColor(small, cv2.COLOR_RGB2BGR), [cv2.IMWRITE_JPEG_QUALITY, _QUALITY])
    return content.tobytes()


# The main program of the easel's process. It stops the robot if it must.
# easel/launch.py starts it as `python -m frida_painter.easel.host WIRE LINE ROBOT`: two inherited sockets, and the
# name of the easel that will be ordered, or "". Requests come over the first socket, heartbeats and stops over the
# second. No work of the painting process delays a stop here.


@dataclass(frozen=True)
class _Deadlines:
    """Time limits of robot and camera, seconds.

    patience: factor by which a motion may exceed the duration of its way
    grace: added to the limit of a motion
    connecting: for the connection
    photograph: for a call of the camera
    answer: after which the painting process gives up this one, for requests without motion
    """

    patience: float
    grace: float
    connecting: float
    photograph: float
    answer: float


_REAL = _Deadlines(patience=2.0, grace=5.0, connecting=30.0, photograph=30.0, answer=60.0)
# The speed of a simulated robot depends on the computer, which may be busy or asleep. A person can always stop it.
_DAY = 86400.0
_SLOW = _Deadlines(patience=20.0, grace=_DAY, connecting=_DAY, photograph=_DAY, answer=_DAY + 60.0)


def main(wire_file: int, line_file: int, robot: str) -> None:
    """Loads the parts for that robot, waits for the order, and serves the easel until the painting ends or is gone."""
    # Ctrl-C and a closed terminal concern the painting process, which then tells this one what to do.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGHUP, signal.SIG_IGN)
    prepare_process()
    load_easel(robot)
    wire, line = Wire(socket.socket(fileno=wire_file)), socket.socket(fileno=line_file)
    try:
        order = EaselOrder.of(wire.receive()[0]["order"])
    except RobotDisconnected:
        return  # the painting process ended before it sent an order
    last_words: dict[str, Any] = {}
    try:
        asked_to_end = _serve(order, wire, line)
    except FridaError as error:
        asked_to_end, last_words = True, encode_error(error)
    if asked_to_end:
        with contextlib.suppress(RobotDisconnected):
            wire.send(last_words)


def _serve(order: EaselOrder, wire: Wire, line: socket.socket) -> bool:
    """Returns True if the painting process asked for the end. Raises a FridaError if the easel cannot be opened."""
    with ExitStack() as stack:
        known = machines(order)
        for identity in sorted(known):
            stack.callback(RobotLock(lock_path(order.state, identity), identity).release)
        opened = open_easel(order)
        stack.callback(opened.close)
        easel = opened.easel
        simulated, known_as = is_simulated(order), easel.calibration.easel
        latch = Unlatched(known_as) if simulated else latch_of(order.state, known_as, known)
        given = _SLOW if simulated else _REAL
        robot = GuardedRobot(
            easel.robot,
            easel.workspace,
            latch,
            patience=given.patience,
            grace=given.grace,
            connecting=given.connecting,
            claim=lambda identity: stack.callback(RobotLock(lock_path(order.state, identity), identity).release),
        )
        if robot.stopped is not None:
            raise RobotStopped(f"{robot.stopped}. Nothing moves until somebody has looked: {HOW_TO_ARM}")
        camera = GuardedCamera(easel.camera, patience=given.photograph)
        stack.callback(_say_end, line, robot)
        stack.callback(robot.close)
        stack.push(partial(_stop_if_unexpected, robot))
        stack.callback(camera.close)

        def end(number: int, frame: FrameType | None) -> NoReturn:
            robot.stop("the easel's process was told to end (SIGTERM)")
            sys.exit(128 + number)

        signal.signal(signal.SIGTERM, end)
        host = Host(robot, camera, easel.operator, easel.reach)
        looked: Callable[[], int] | None = None
        if order.folder is not None:
            file = StopFile(order.folder / STOP_FILE, partial(robot.stop, asked=True), host.remarks.append)
            stack.callback(file.dismiss)
            looked = lambda: file.looks  # noqa: E731
            stack.callback(LivePicture(camera, order.folder / LIVE_PICTURE).dismiss)
        watch = Watch(
            line,
            robot.stop,
            lambda: robot.moving,
            CpuActivity(os.getppid()),
            SIMULATED if simulated else MACHINE,
            stopped=lambda: robot.stopped is not None,
            stop_line=robot.stop_line,
            looked=looked,
        )
        stack.callback(watch.dismiss)
        limits_told = {"patience": given.patience, "grace": given.grace, "answer": given.answer}
        wire.send({**_about(easel), "machines": sorted(known), "simulated": simulated, **limits_told})
        return host.serve(wire)


def _say_end(line: socket.socket, robot: GuardedRobot) -> None:
    """Tells the painting process that the robot is closed, and if it is stopped."""
    with contextlib.suppress(OSError):
        line.send((STOP if robot.stopped is not None else b"") + ENDED)


def _stop_if_unexpected(
    robot: GuardedRobot, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
) -> None:
    """Stops the robot if this process fails by itself, for example for lack of memory."""
    if error is not None and not isinstance(error, FridaError | SystemExit):
        robot.stop(f"the easel's process failed ({one_line(error)})")


def _about(easel: Easel) -> dict[str, Any]:
    """Returns the facts about the easel for the painting process, as plain values."""
    return {
        "workspace": TypeAdapter(Workspace).dump_python(easel.workspace, mode="json"),
        "calibration": TypeAdapter(Calibration).dump_python(easel.calibration, mode="json"),
        "canvas": TypeAdapter(CanvasSize).dump_python(easel.canvas, mode="json"),
        "knows_reach": easel.reach is not None,
        "has_camera": easel.has_camera,
        "person_brushes": TypeAdapter(tuple[PersonBrush, ...]).dump_python(easel.person_brushes, mode="json"),
        "pace": easel.pace,
        "timing": TypeAdapter(Timing | AxisTiming | None).dump_python(easel.timing, mode="json"),
    }


if __name__ == "__main__":
    main(int(sys.argv[1]), int(sys.argv[2]), sys.argv[3])
