"""The easel's own process: owns robot and camera, does what the painting asks for, and stops when it must.

Started by easel_process.py as `python -m frida_painter.session.easel_host WIRE LINE ROBOT`, two sockets that
it inherits, and the easel that will be ordered, or nothing: requests come over the first socket, heartbeats
and stops over the second. Nothing that the painting process is busy with delays a stop here.
"""

import contextlib
import os
import signal
import socket
import sys
from contextlib import ExitStack
from dataclasses import dataclass
from functools import partial
from types import FrameType
from typing import Any, NoReturn

from pydantic import TypeAdapter

from frida_painter.calibration import Calibration
from frida_painter.errors import FridaError, RobotDisconnected, RobotStopped
from frida_painter.frames import CanvasSize
from frida_painter.hardware.easel import Easel
from frida_painter.hardware.guard import GuardedRobot
from frida_painter.hardware.guarded_camera import GuardedCamera
from frida_painter.hardware.latch import HOW_TO_ARM, Latch, Unlatched, latch_path
from frida_painter.hardware.link.cpu_activity import CpuActivity
from frida_painter.hardware.link.host import Host, told
from frida_painter.hardware.link.silence import MACHINE, SIMULATED
from frida_painter.hardware.link.watch import StopFile, Watch
from frida_painter.hardware.link.wire import Wire
from frida_painter.hardware.live_picture import LivePicture
from frida_painter.hardware.lock import RobotLock
from frida_painter.hardware.timing import Timing
from frida_painter.hardware.workspace import Workspace
from frida_painter.session.easel_order import EaselOrder
from frida_painter.session.easels import is_simulated, load_easel, lock_path, machines, open_easel
from frida_painter.session.names import LIVE_PICTURE, STOP_FILE
from frida_painter.session.opening import prepare_process


@dataclass(frozen=True)
class _Deadlines:
    """Seconds that robot and camera are given; patience: how many times longer than its way takes a motion may last.

    answer: after which the painting process gives this one up, where it asked for no motion.
    """

    patience: float
    grace: float
    connecting: float
    photograph: float
    answer: float


_REAL = _Deadlines(patience=2.0, grace=5.0, connecting=30.0, photograph=30.0, answer=60.0)
# A simulated robot has the pace of the computer, which may be busy, or asleep. Whoever does not want to wait stops it.
_DAY = 86400.0
_SLOW = _Deadlines(patience=20.0, grace=_DAY, connecting=_DAY, photograph=_DAY, answer=_DAY + 60.0)


def main(wire_file: int, line_file: int, robot: str) -> None:
    """Loads what that robot needs, waits for the order, and serves the easel until the painting is done or gone."""
    # Ctrl-C and a closed terminal concern the painting; it says here what is to be done.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGHUP, signal.SIG_IGN)
    prepare_process()
    load_easel(robot)
    wire, line = Wire(socket.socket(fileno=wire_file)), socket.socket(fileno=line_file)
    try:
        order = EaselOrder.of(wire.receive()[0]["order"])
    except RobotDisconnected:
        return  # the painting process ended before it wanted anything
    last_words: dict[str, Any] = {}
    try:
        asked_to_end = _serve(order, wire, line)
    except FridaError as error:
        asked_to_end, last_words = True, told(error)
    if asked_to_end:
        with contextlib.suppress(RobotDisconnected):
            wire.send(last_words)


def _serve(order: EaselOrder, wire: Wire, line: socket.socket) -> bool:
    """Whether the painting process asked for the end. Raises errors of the tree where the easel cannot be had."""
    with ExitStack() as stack:
        known = machines(order)
        for identity in sorted(known):
            stack.callback(RobotLock(lock_path(order.state, identity), identity).release)
        opened = open_easel(order)
        stack.callback(opened.close)
        easel = opened.easel
        simulated, known_as = is_simulated(order), easel.calibration.easel
        latch = Unlatched(known_as) if simulated else Latch(latch_path(order.state, known_as), known_as, known)
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
        stack.callback(robot.close)
        stack.callback(camera.close)

        def end(number: int, frame: FrameType | None) -> NoReturn:
            robot.stop("the easel's process was told to end (SIGTERM)")
            sys.exit(128 + number)

        signal.signal(signal.SIGTERM, end)
        if order.folder is not None:
            stack.callback(StopFile(order.folder / STOP_FILE, partial(robot.stop, asked=True)).dismiss)
            stack.callback(LivePicture(camera, order.folder / LIVE_PICTURE).dismiss)
        limits = SIMULATED if simulated else MACHINE
        stopped = partial(_is_stopped, robot)
        painter = CpuActivity(os.getppid())
        stack.callback(Watch(line, robot.stop, lambda: robot.moving, painter, limits, stopped=stopped).dismiss)
        limits_told = {"patience": given.patience, "grace": given.grace, "answer": given.answer}
        wire.send({**_about(easel), "simulated": simulated, **limits_told})
        return Host(robot, camera, easel.operator, easel.reach).serve(wire)


def _is_stopped(robot: GuardedRobot) -> bool:
    return robot.stopped is not None


def _about(easel: Easel) -> dict[str, Any]:
    """What the painting process has to know of the easel, as plain values."""
    return {
        "workspace": TypeAdapter(Workspace).dump_python(easel.workspace, mode="json"),
        "calibration": TypeAdapter(Calibration).dump_python(easel.calibration, mode="json"),
        "canvas": TypeAdapter(CanvasSize).dump_python(easel.canvas, mode="json"),
        "knows_reach": easel.reach is not None,
        "pace": easel.pace,
        "timing": TypeAdapter(Timing | None).dump_python(easel.timing, mode="json"),
    }


if __name__ == "__main__":
    main(int(sys.argv[1]), int(sys.argv[2]), sys.argv[3])
