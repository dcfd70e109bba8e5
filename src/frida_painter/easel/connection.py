"""The connection between a painting process and its easel's process: requests and their answers.

The methods of an easel's parts are requests, all made from their protocols: arguments and results travel by the types
that the protocols state (messages.py).
"""

import contextlib
import inspect
import socket
import subprocess
import threading
import time
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cache
from types import MappingProxyType
from typing import Any, TypeVar, get_type_hints

from frida_painter.easel.watchdog import Pulse
from frida_painter.errors import FridaError, ProcessLost, RobotAbandoned, RobotDisconnected, RobotError
from frida_painter.hardware.easel import Operator, PersonCanvas
from frida_painter.hardware.gateway import CheckedRobot
from frida_painter.hardware.latch import Latch, Unlatched
from frida_painter.hardware.robot import (
    Camera,
    LimitedRobot,
    PausableRobot,
    Robot,
    TimedRobot,
    TouchProbe,
    ZeroedRobot,
)
from frida_painter.system.messages import Arrays, Wire, decode_error, encode_error, pack, unpack

T = TypeVar("T")

# Requests.

_PROTOCOLS: Mapping[str, tuple[type, ...]] = MappingProxyType(
    {
        "robot": (Robot, ZeroedRobot, TimedRobot, LimitedRobot, PausableRobot, TouchProbe, CheckedRobot),
        "camera": (Camera,),
        "operator": (Operator, PersonCanvas),
    }
)
"""Protocols of each part of an easel."""


@dataclass(frozen=True)
class Request:
    """Method of a part, as a request to the easel's process.

    part, method: such as "robot" and "follow"
    types: of the arguments by name, and of the result as "return"
    """

    part: str
    method: str
    signature: inspect.Signature
    types: Mapping[str, Any]

    def pack(self, arguments: Mapping[str, Any]) -> tuple[dict[str, Any], Arrays]:
        """Returns the request with its arguments by name, as plain values and arrays."""
        arrays: Arrays = {}
        told = {name: pack(value, self.types[name], arrays) for name, value in arguments.items()}
        return {"part": self.part, "do": self.method, "with": told}, arrays

    def answer(self, target: object, told: Mapping[str, Any], arrays: Arrays) -> tuple[dict[str, Any], Arrays]:
        """Calls the method of `target`, and returns its result as plain values and arrays.

        Raises RobotError if `target` does not have it, and the errors of the method.
        """
        if (method := getattr(target, self.method, None)) is None:
            raise RobotError(f"The easel has no {self.part + '.' + self.method!r}.")
        found = self.signature.bind(None, **{name: unpack(told[name], self.types[name], arrays) for name in told})
        result = method(*found.args[1:], **found.kwargs)  # a driver may call its arguments by other names
        sent: Arrays = {}
        return {"result": pack(result, self.types["return"], sent)}, sent

    def result(self, words: Mapping[str, Any], arrays: Arrays) -> Any:
        """Returns the result in the answer to this request. Raises RobotError if it does not fit."""
        try:
            return unpack(words["result"], self.types["return"], arrays)
        except (AttributeError, KeyError, TypeError, ValueError) as error:
            raise RobotError(f"The easel's process told of {self.method!r} what cannot be ({error}).") from error


@cache
def requests(part: str) -> Mapping[str, Request]:
    """Returns the requests of a part by the names of their methods; none of an unknown part."""
    return {
        name: Request(part, name, inspect.signature(method), get_type_hints(method))
        for protocol in _PROTOCOLS.get(part, ())
        for name, method in vars(protocol).items()
        if inspect.isfunction(method) and not name.startswith("_")
    }


def find_request(words: Mapping[str, Any]) -> Request:
    """Returns the request that came as plain values. Raises RobotError if there is none of that name."""
    part, method = str(words.get("part")), str(words.get("do"))
    if (found := requests(part).get(method)) is None:
        raise RobotError(f"The easel's process was asked for {part + '.' + method!r}, which it does not know.")
    return found


def answering(part: str, answer: Callable[[Any, Request, Mapping[str, Any]], Any]) -> Callable[[type[T]], type[T]]:
    """Decorates the class of a part: each request of the part that it has no method for becomes a call of `answer`.

    answer: receives the object, the request and its arguments by name
    """

    def method(request: Request) -> Callable[..., Any]:
        def call(self: object, *given: Any, **named: Any) -> Any:
            found = request.signature.bind(self, *given, **named).arguments
            return answer(self, request, {name: value for name, value in found.items() if name != "self"})

        return call

    def complete(made: type[T]) -> type[T]:
        for name, request in requests(part).items():
            if name not in vars(made):
                setattr(made, name, method(request))
        return made

    return complete


def make_remote(part: str, ask: Callable[[Request, Mapping[str, Any]], Any], **own: Callable[..., Any]) -> Any:
    """Returns a part of an easel in another process: its methods are the requests of the part.

    ask: sends a request with its arguments by name, and returns its result
    own: methods that are no requests
    """
    made: type[Any] = type(f"Remote{part.title()}", (), {name: staticmethod(act) for name, act in own.items()})
    return answering(part, lambda _, request, given: ask(request, given))(made)()


# The easel's end.


@dataclass(frozen=True)
class Host:
    """Server of an easel over a wire.

    parts: robot and camera under guard, and operator, by the names that requests give them
    remarks: sentences for people, which go with the next answer
    """

    parts: Mapping[str, Any]
    remarks: deque[str] = field(default_factory=deque)

    def serve(self, wire: Wire) -> None:
        """Answers requests until the painting process asks for the end. That request is left for the caller to answer.

        Raises ProcessLost if the painting process is gone.
        """
        while True:
            words, arrays = wire.receive()
            if words.get("do") == "end":
                return
            answer, result = self._answer(words, arrays)
            told = [self.remarks.popleft() for _ in range(len(self.remarks))]
            machines = sorted(self.parts["robot"].latch.machines)
            wire.send({**answer, "remarks": told, "machines": machines}, result)

    def _answer(self, words: Mapping[str, Any], arrays: Arrays) -> tuple[dict[str, Any], Arrays]:
        try:
            request = find_request(words)
            return request.answer(self.parts[request.part], words["with"], arrays)
        except FridaError as error:
            return encode_error(error), {}
        except Exception as error:  # also of our own code: the painting process must hear of it
            return encode_error(RobotError(f"The easel's process could not do {words.get('do')!r} ({error!r}).")), {}


# The painting process's end.

_CALL = 60.0  # seconds for a request, if the easel's process promised no time for it
_MARGIN = 10.0  # for a process that hangs as a whole; the guard there gives up a driver earlier
_MAX_SILENCE = 10.0  # seconds without a heartbeat after which the process counts as hung or frozen
_LOOK_EVERY = 0.25
_HEEDING, _WRITING = 1.0, 10.0  # within which a process that lives takes a stop, and a disk stores one


class Link:
    """Link to the easel's process: sends one request at a time.

    line: for heartbeats and stops, see watchdog.Pulse
    process: of the easel; it is ended if it neither answers nor takes a stop
    tell: receives sentences of the easel's process for people
    patience: seconds to wait for an answer, or for the promise of a later one
    most_silence: greatest time without a heartbeat during the wait, seconds
    latch: stores the stop of a connected robot whose process vanished; None until the easel is open

    Raises RobotDisconnected if there is no answer, after sending a stop. The link is then broken for good.
    Raises the errors that the easel reports.
    """

    def __init__(
        self,
        wire: Wire,
        line: socket.socket,
        process: subprocess.Popen[bytes] | None = None,
        tell: Callable[[str], None] = lambda remark: None,
    ) -> None:
        self._wire, self._process, self._tell = wire, process, tell
        self.patience, self.most_silence = _CALL, _MAX_SILENCE
        self.latch: Latch | Unlatched | None = None
        self._turn = threading.Lock()
        self._broken: RobotDisconnected | None = None
        # From the request to connect until the robot is closed; otherwise it cannot move.
        self._connected = False
        self._held = False  # the machine itself got a stop
        self._unkept: FridaError | None = None
        self.pulse = Pulse(line, self._lose)

    def call(self, request: Request, arguments: Mapping[str, Any]) -> Any:
        """Returns the result of a request with its arguments by name."""
        return request.result(*self.ask(*request.pack(arguments)))

    def ask(self, words: Mapping[str, Any], arrays: Arrays | None = None) -> tuple[dict[str, Any], Arrays]:
        """Returns the answer of the easel's process to a request."""
        part, task = words.get("part"), words["do"]
        with self._turn:
            if self._broken is not None:
                raise self._broken.with_traceback(None)
            if (part, task) == ("robot", "connect"):
                self._connected = True
            try:
                self._wire.send(words, arrays)
                # The process sends no heartbeats while it closes everything.
                answer, result = self._answer(listen=task != "end")
            except ProcessLost as error:
                self._broken = self._give_up(error)
                raise self._broken from error
        for remark in answer.get("remarks", ()):
            self._tell(str(remark))
        if self.latch is not None:
            self.latch.machines = frozenset(answer.get("machines", self.latch.machines))
        if "error" in answer:
            raise decode_error(answer, RobotError)
        if task == "end" or (part, task) == ("robot", "close"):
            self._connected = False
        return answer, result

    def _answer(self, *, listen: bool) -> tuple[dict[str, Any], Arrays]:
        now = began = time.monotonic()
        until = began + self.patience
        while True:
            while now < until and not self._wire.waits(min(_LOOK_EVERY, until - now)):
                now = time.monotonic()
                silent = min(self.pulse.silent, now - began)
                if listen and silent > self.most_silence:
                    raise ProcessLost(f"Nothing has been heard from it for {silent:.0f} s.")
            answer, arrays = self._wire.receive(max(until - time.monotonic(), 0.0))
            if "within" not in answer:
                return answer, arrays
            until = max(until, time.monotonic() + float(answer["within"]) + _MARGIN)

    def _give_up(self, error: ProcessLost) -> RobotDisconnected:
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
            return self._explain(why or self._describe_end())
        return RobotDisconnected(
            f"The easel's process does not answer ({error}) The robot was told to stop; look at it before going on."
        )

    def _lose(self, held: bool) -> None:
        """Stores the stop of a connected robot whose process vanished. held: True if the machine itself got a stop."""
        self._held = held
        if self._connected and self.latch is not None:
            try:
                self.latch.engage("its process was killed or crashed, perhaps in the middle of a motion")
            except FridaError as failure:
                self._unkept = failure

    def _explain(self, why: str) -> RobotDisconnected:
        """Returns the error for people, after `_lose`. why: how the process ended, in words."""
        told = f"The easel's process is gone ({why}). "
        if not self._connected or self.latch is None:
            return RobotAbandoned(f"{told}The robot was not connected, and did not move.", held=False, latched=False)
        if isinstance(self.latch, Unlatched):
            return RobotAbandoned(f"{told}It was a simulated robot; resume the painting.", held=False, latched=False)
        told += (
            "This process told the machine to hold over the same line. "
            if self._held
            else "Nobody could tell the robot to stop: what its board had received is finished. "
        )
        if self._unkept is not None:
            told += f"The stop could not be stored ({self._unkept}) Start nothing before somebody has looked at it."
        else:
            told += f"It is stopped for this program until you arm it: {self.latch.remedy}"
        return RobotAbandoned(told, held=self._held, latched=self._unkept is None)

    def _describe_end(self) -> str:
        ended = None
        if self._process is not None:
            with contextlib.suppress(subprocess.TimeoutExpired):
                ended = self._process.wait(_HEEDING)
        if ended is None:
            return "nobody knows why"
        return f"signal {-ended}" if ended < 0 else f"exit status {ended}"

    def end(self, *, ask: bool = True) -> None:
        """Disconnects from the easel's process. Raises the errors that it reports.

        ask: True to wait first until the process has closed everything
        """
        try:
            if ask and self._broken is None:
                self.ask({"do": "end"})
        finally:
            self._wire.close()
            self.pulse.end()
