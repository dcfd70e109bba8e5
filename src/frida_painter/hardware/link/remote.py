"""The painting process's end of the link: a robot, a camera and an operator that are really in another process."""

import threading
import time
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from frida_painter import errors
from frida_painter.errors import FridaError, MotionFailed, RobotBusy, RobotDisconnected, RobotError, RobotStopped
from frida_painter.hardware.camera import Frame
from frida_painter.hardware.link.watch import Pulse
from frida_painter.hardware.link.wire import Arrays, Wire
from frida_painter.hardware.robot import MotionReport, Waypoints
from frida_painter.hardware.workspace import Workspace
from frida_painter.palette import Palette

# The guard in the easel's process gives up a driver sooner; this is for a process that hangs as a whole.
_MARGIN = 10.0
_CALL = 60.0
# One that sends no heartbeat for so long hangs, or was frozen.
_MOST_SILENCE = 10.0
_LOOK_EVERY = 0.25
_END = "end"  # while it closes everything there are no heartbeats any more


class Link:
    """Asks the easel's process, one request at a time; after one that was not answered it is broken for good.

    patience: seconds for an answer, where a request does not say; most_silence: seconds without a heartbeat from there,
    while an answer is waited for. Raises RobotDisconnected, having sent a stop, where
    there is no answer; otherwise what the easel raised.
    """

    def __init__(self, wire: Wire, pulse: Pulse) -> None:
        self._wire, self._pulse = wire, pulse
        self.patience, self.most_silence = _CALL, _MOST_SILENCE
        self._turn = threading.Lock()
        self._broken: RobotDisconnected | None = None

    def ask(
        self, do: str, arrays: Arrays | None = None, *, within: float | None = None, **words: object
    ) -> tuple[Mapping[str, Any], Mapping[str, NDArray[Any]]]:
        """What the easel's process answers to a request, within so many seconds, by default the link's patience."""
        with self._turn:
            if self._broken is not None:
                raise RobotDisconnected(str(self._broken))
            try:
                self._wire.send({"do": do, **words}, arrays)
                answer, result = self._answer(self.patience if within is None else within, listen=do != _END)
            except RobotDisconnected as error:
                self._pulse.stop()
                self._broken = RobotDisconnected(
                    f"The easel's process does not answer ({error}) The robot was told to stop; look at it before "
                    "going on."
                )
                raise self._broken from error
        if "error" in answer:
            raise heard(answer)
        return answer, result

    def _answer(self, within: float, *, listen: bool) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
        now = began = time.monotonic()
        while now < began + within and not self._wire.waits(min(_LOOK_EVERY, began + within - now)):
            now = time.monotonic()
            silent = min(self._pulse.silent, now - began)
            if listen and silent > self.most_silence:
                raise RobotDisconnected(f"Nothing has been heard from it for {silent:.0f} s.")
        return self._wire.receive(max(began + within - time.monotonic(), 0.0))

    def stop(self) -> None:
        """Stops the robot at once, whatever is being asked."""
        self._pulse.stop()

    def end(self, *, ask: bool = True) -> None:
        """Lets go of the easel's process; ask: has it say first that all is closed. Raises what went wrong there."""
        try:
            if ask and self._broken is None:
                self.ask(_END)
        finally:
            self._wire.close()
            self._pulse.end()


class RemoteRobot:
    """Implements hardware.robot.Robot over a link; patience, grace: see hardware.guard.GuardedRobot."""

    def __init__(self, link: Link, workspace: Workspace, *, patience: float, grace: float) -> None:
        self._link, self._patience, self._grace = link, patience, grace
        self._reach = float(np.linalg.norm(np.subtract(workspace.upper, workspace.lower)))
        self._travel_speed = workspace.travel_speed

    def connect(self) -> None:
        """Reaches the robot. Raises RobotError and its kinds."""
        self._link.ask("robot.connect")

    def home(self) -> MotionReport:
        """Goes aside. Raises RobotError and its kinds."""
        return self._report("robot.home", self._reach / self._travel_speed)

    def pose(self) -> NDArray[np.float64]:
        """Where the tip is, [3] metres. Raises RobotError and its kinds."""
        return self._link.ask("robot.pose")[1]["pose"]

    def follow(self, waypoints: Waypoints) -> MotionReport:
        """Moves along the waypoints. Raises RobotError and its kinds."""
        position = np.asarray(waypoints.position, np.float64)
        seconds = (waypoints.length + self._reach) / waypoints.speed if waypoints.speed > 0 else 0.0
        return self._report(
            "robot.follow", seconds, {"position": position}, label=waypoints.label, speed=float(waypoints.speed)
        )

    def stop(self) -> None:
        """Stops at once, over a line of its own."""
        self._link.stop()

    def close(self) -> None:
        """Lets go of the robot. Raises RobotError and its kinds."""
        self._link.ask("robot.close")

    def _report(self, do: str, seconds: float, arrays: Arrays | None = None, **words: object) -> MotionReport:
        within = seconds * self._patience + self._grace + _MARGIN
        answer, result = self._link.ask(do, arrays, within=within, **words)
        return MotionReport(answer["label"], answer["started_at"], answer["finished_at"], result["reached"])


class RemoteReach:
    """Implements hardware.reach.Reach over a link."""

    def __init__(self, link: Link) -> None:
        self._link = link

    def reachable(self, position: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Whether the tip can be at each place [k, 3] metres: [k]."""
        _, result = self._link.ask("robot.reaches", {"position": np.asarray(position, np.float64)})
        return result["reachable"].astype(np.bool_)


class RemoteCamera:
    """Implements hardware.camera.Camera over a link."""

    def __init__(self, link: Link) -> None:
        self._link = link

    def connect(self) -> None:
        """Reaches the camera. Raises CameraError and its kinds."""
        self._link.ask("camera.connect")

    def capture(self, newer_than: float) -> Frame:
        """A photograph taken after `newer_than` (s). Raises CameraError and its kinds."""
        answer, result = self._link.ask("camera.capture", newer_than=float(newer_than))
        return Frame(result["image"], answer["captured_at"], answer["sequence"])

    def close(self) -> None:
        """Lets go of the camera. Raises CameraError and its kinds."""
        self._link.ask("camera.close")


class RemoteOperator:
    """Implements hardware.easel.Operator over a link."""

    def __init__(self, link: Link) -> None:
        self._link = link

    def fill_wells(self, palette: Palette) -> None:
        """Has well i filled with paint i."""
        self._link.ask("operator.fill_wells", {"color": palette.color.detach().cpu().numpy()})

    def tone(self, ground: tuple[float, float, float]) -> None:
        """Has the canvas toned in that colour (sRGB)."""
        self._link.ask("operator.tone", ground=list(ground))

    def change_brush(self, brush: str) -> None:
        """Has the brush of that name put into the holder."""
        self._link.ask("operator.change_brush", brush=brush)

    def let_dry(self, seconds: float) -> None:
        """Has the paint dry for so long."""
        self._link.ask("operator.let_dry", seconds=seconds)

    def lay_paper(self) -> bool:
        """Whether a fresh canvas lies there now."""
        return bool(self._link.ask("operator.lay_paper")[0]["done"])

    def lay_checker(self) -> bool:
        """Whether the colour checker lies there now."""
        return bool(self._link.ask("operator.lay_checker")[0]["done"])

    def take_checker_away(self) -> bool:
        """Whether the colour checker is gone again."""
        return bool(self._link.ask("operator.take_checker_away")[0]["done"])


def heard(answer: Mapping[str, Any]) -> FridaError:
    """The error that the other end told of; a plain RobotError where it is of an unknown kind."""
    kind, message, details = getattr(errors, str(answer["error"]), None), str(answer["message"]), answer["details"]
    if kind is RobotBusy:
        return RobotBusy(message, details.get("pid"))
    if kind is MotionFailed:
        return MotionFailed(message, details.get("code"), details.get("waypoint"))
    if kind is RobotStopped:
        return RobotStopped(message, asked=details.get("asked") is True)
    if isinstance(kind, type) and issubclass(kind, FridaError):
        return kind(message)
    return RobotError(message)
