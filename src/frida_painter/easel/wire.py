"""Messages between two processes over a socket: a JSON object with arrays of numbers, without executable content.

Eight bytes give the lengths of the object and of the arrays' bytes, each with an upper limit. The object's entry
"arrays" describes the arrays. All other content is refused.
"""

import json
import math
import select
import socket
import struct
import threading
import time
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from frida_painter.errors import RobotDisconnected

Arrays = Mapping[str, NDArray[Any]]

_LENGTHS = struct.Struct("<II")
_MAX_WORDS = 2**20
_MAX_BYTES = 2**28
ARRAY_KINDS = ("|b1", "|u1", "<f4", "<f8")
"""Kinds of numbers that arrays may have."""


class Wire:
    """End of a link: sends and receives whole messages.

    Raises RobotDisconnected if the other end is gone, too late, or sends anything but messages.
    """

    def __init__(self, socket: socket.socket) -> None:
        self._socket = socket
        self._sending = threading.Lock()

    def send(self, words: Mapping[str, Any], arrays: Arrays | None = None) -> None:
        """Sends a JSON object and arrays of bool, uint8, float32 or float64 of any shape. Raises RobotDisconnected."""
        parts = {name: np.asarray(array, order="C") for name, array in (arrays or {}).items()}
        kinds = {name: [array.dtype.str, list(array.shape)] for name, array in parts.items()}
        head = json.dumps({**words, "arrays": kinds}).encode()
        size = sum(array.nbytes for array in parts.values())
        try:
            with self._sending:
                self._socket.settimeout(None)
                self._socket.sendall(_LENGTHS.pack(len(head), size) + head)
                for array in parts.values():  # without a copy: a photograph has millions of bytes
                    self._socket.sendall(array.reshape(-1).view(np.uint8).data)
        except OSError as error:
            raise RobotDisconnected(f"The other end of the easel's link is gone ({error}).") from error

    def receive(self, within: float | None = None) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
        """Returns the next message: its object and its arrays. Raises RobotDisconnected.

        within: seconds to wait for the whole message; None for no limit
        """
        until = None if within is None else time.monotonic() + within
        words, size = _LENGTHS.unpack(bytes(self._exactly(_LENGTHS.size, until)))
        if words > _MAX_WORDS or size > _MAX_BYTES:
            raise RobotDisconnected(
                f"A message of {words} + {size} bytes came over the easel's link; that is no message."
            )
        head, body = bytes(self._exactly(words, until)), self._exactly(size, until)
        try:
            said = json.loads(head)
            return said, _unpack(said.pop("arrays"), body)
        except (ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
            raise RobotDisconnected(f"What came over the easel's link is no message ({error}).") from error

    def waits(self, seconds: float) -> bool:
        """Returns True if a message came, or the other end closed, within `seconds`."""
        return bool(select.select([self._socket], [], [], seconds)[0])

    def close(self) -> None:
        """Closes this end; the other end notices it."""
        self._socket.close()

    def _exactly(self, count: int, until: float | None) -> NDArray[np.uint8]:
        """Returns the next `count` bytes [count]."""
        content = np.empty(count, np.uint8)
        room, got = content.data, 0
        while got < count:
            # Bytes that are already there are read even if it is late: then this process did not run.
            left = None if until is None else max(until - time.monotonic(), 0.0)
            try:
                self._socket.settimeout(left)
                part = self._socket.recv_into(room[got:])
            except (TimeoutError, BlockingIOError) as nothing:
                if left:
                    continue  # it may have come at the last moment
                raise RobotDisconnected("The other end of the easel's link did not answer in time.") from nothing
            except OSError as error:
                raise RobotDisconnected(f"The other end of the easel's link is gone ({error}).") from error
            if not part:
                raise RobotDisconnected("The other end of the easel's link is gone.")
            got += part
        return content


def _unpack(kinds: Mapping[str, Any], body: NDArray[np.uint8]) -> dict[str, NDArray[Any]]:
    """Returns the arrays of a message. Raises ValueError, KeyError or TypeError if the bytes do not match."""
    arrays, start = {}, 0
    for name, (kind, shape) in kinds.items():
        if not all(isinstance(length, int) and 0 <= length <= _MAX_BYTES for length in shape):
            raise ValueError(f"array {name} of shape {shape}")
        if kind not in ARRAY_KINDS:
            raise ValueError(f"array {name} of {kind}")
        dtype = np.dtype(kind)
        end = start + math.prod(shape) * dtype.itemsize
        part = body[start:end]
        aligned = start % dtype.itemsize == 0
        arrays[name] = (part if aligned else part.copy()).view(dtype).reshape(shape)
        start = end
    if start != len(body):
        raise ValueError(f"{len(body)} bytes of arrays, {start} announced")
    return arrays
