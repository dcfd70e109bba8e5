"""The easel's process: owns robot and camera, and answers the painting process's requests one after another.

easel/parent.py starts it (`serve_easel`). Requests come over one socket, heartbeats and stops over another. No work of
the painting process delays a stop here.
"""

import contextlib
import math
import os
import signal
import socket
import sys
import threading
from collections.abc import Mapping
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from types import FrameType, TracebackType
from typing import Any, NoReturn

import cv2
import numpy as np
from numpy.typing import NDArray
from pydantic import TypeAdapter, ValidationError

from frida_painter.easel.connection import Host
from frida_painter.easel.guard import GuardedCamera, GuardedRobot
from frida_painter.easel.kinds import LIVE_PICTURE, STOP_FILE, is_simulated
from frida_painter.easel.open import hold_machines, load_easel, machines, open_easel
from frida_painter.easel.order import FACTS, EaselFacts, EaselOrder
from frida_painter.easel.watchdog import ENDED, MACHINE, SIMULATED, STOP, CpuActivity, StopFile, Watch
from frida_painter.errors import ConfigError, FridaError, RobotStopped
from frida_painter.hardware.deadline import one_line
from frida_painter.hardware.gateway import MotionLimits, Surface
from frida_painter.hardware.latch import HOW_TO_ARM, Unlatched, latch_of
from frida_painter.hardware.robot import LiveCamera
from frida_painter.system import storage
from frida_painter.system.devices import prepare_process
from frida_painter.system.messages import Wire
from frida_painter.system.operating_system import SIGNALS
from frida_painter.system.python_process import in_own_process

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
            with contextlib.suppress(Exception):  # whatever it is, the next picture may succeed
                picture = self._camera.glance()
                if picture is not None:
                    storage.write_bytes(self._path, encode_jpeg(picture))
        self._path.unlink(missing_ok=True)  # a picture that came late


def encode_jpeg(picture: NDArray[np.uint8]) -> bytes:
    """Returns a picture [rows, columns, 3] sRGB as JPEG, at most 960 pixels wide."""
    share = min(1.0, _WIDEST / picture.shape[1])
    small = cv2.resize(picture, None, fx=share, fy=share, interpolation=cv2.INTER_AREA) if share < 1 else picture
    _, content = cv2.imencode(".jpg", cv2.cvtColor(small, cv2.COLOR_RGB2BGR), [cv2.IMWRITE_JPEG_QUALITY, _QUALITY])
    return content.tobytes()


@in_own_process()
def serve_easel(wire: Wire, line: socket.socket, name: str) -> None:
    """Loads the parts for an easel, waits for the order, and serves the easel until the painting ends or is gone.

    wire: for requests
    line: for heartbeats and stops
    name: of the easel that will be ordered; "" if it is not known yet
    """
    # Ctrl-C and a closed terminal concern the painting process, which then tells this one what to do.
    for number in {*SIGNALS} - {signal.SIGTERM}:
        signal.signal(number, signal.SIG_IGN)
    prepare_process()
    load_easel(name)
    order = _read_order(wire.receive()[0])
    with ExitStack() as stack:
        known = machines(order)
        hold_machines(stack, order.state, known)
        opened = open_easel(order)
        stack.callback(opened.close)
        easel = opened.easel
        simulated, known_as = is_simulated(order.robot), easel.calibration.easel
        # A simulated robot is as slow as the computer, which may be busy or asleep. A person can always stop it.
        patience: dict[str, float] = {"grace": math.inf, "connecting": math.inf} if simulated else {}
        robot = GuardedRobot(
            easel.robot,
            MotionLimits(easel.workspace, Surface.of(easel.canvas, easel.calibration), easel.reach),
            Unlatched(known_as) if simulated else latch_of(order.state, known_as, known),
            claim=lambda identity: hold_machines(stack, order.state, {identity}),
            promise=lambda seconds: wire.send({"within": seconds}),
            **patience,
        )
        if robot.stopped is not None:
            raise RobotStopped(f"{robot.stopped}. Nothing moves until somebody has looked: {HOW_TO_ARM}")
        camera = GuardedCamera(easel.camera, **({"patience": math.inf} if simulated else {}))
        stack.callback(_say_end, line, robot)
        stack.callback(robot.close)
        stack.push(partial(_stop_if_unexpected, robot))
        stack.callback(camera.close)

        def end(number: int, frame: FrameType | None) -> NoReturn:
            robot.stop("the easel's process was told to end (SIGTERM)")
            sys.exit(128 + number)

        signal.signal(signal.SIGTERM, end)
        host = Host({"robot": robot, "camera": camera, "operator": easel.operator})
        file: StopFile | None = None
        if order.folder is not None:
            file = StopFile(order.folder / STOP_FILE, partial(robot.stop, asked=True), host.remarks.append)
            stack.callback(file.dismiss)
            stack.callback(LivePicture(camera, order.folder / LIVE_PICTURE).dismiss)
        rule = SIMULATED if simulated else MACHINE
        stack.callback(Watch(line, robot, CpuActivity(os.getppid()), rule, file).dismiss)
        facts = EaselFacts(**{name: getattr(easel, name) for name in FACTS})
        wire.send({"facts": TypeAdapter(EaselFacts).dump_python(facts, mode="json"), "machines": sorted(known)})
        host.serve(wire)


def _read_order(words: Mapping[str, Any]) -> EaselOrder:
    try:
        return TypeAdapter(EaselOrder).validate_python(words.get("order"))
    except ValidationError as error:
        faults = "; ".join(f"{'.'.join(map(str, fault['loc']))}: {fault['msg']}" for fault in error.errors())
        raise ConfigError(f"The order of the easel is none ({faults}); start the painting again.") from error


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
