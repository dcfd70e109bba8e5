"""Messages between the painter's processes: a JSON object with arrays of numbers, and bytes.

Values travel by the types that functions state (numbers, texts, paths, bytes, tuples, arrays, tensors and dataclasses
of these), errors by name, sentence and fields. Nothing that comes is executed. A process that sends no array loads
neither NumPy nor PyTorch here.
"""

import contextlib
import inspect
import json
import math
import selectors
import socket
import struct
import sys
import threading
import time
from collections.abc import Mapping
from dataclasses import is_dataclass
from pathlib import Path
from types import NoneType
from typing import TYPE_CHECKING, Any, Literal, get_args, get_origin, get_type_hints

from frida_painter import errors
from frida_painter.errors import FridaError, ProcessLost

if TYPE_CHECKING:
    from numpy.typing import NDArray

Arrays = dict[str, "NDArray[Any] | bytes"]

_LENGTHS = struct.Struct("<II")  # of the object and of the arrays' bytes
_MAX_WORDS = 2**20
_MAX_BYTES = 2**28
_Selector = getattr(selectors, "PollSelector", selectors.SelectSelector)  # the first takes files above 1023
_KINDS = ("bytes", "|b1", "|u1", "<f4", "<f8")


class Wire:
    """End of a link between two processes: sends and receives whole messages.

    Raises ProcessLost if the other end is gone, too late, or sends anything but messages.
    """

    def __init__(self, socket: socket.socket) -> None:
        self._socket = socket
        self._sending = threading.Lock()

    def send(self, words: Mapping[str, Any], arrays: "Mapping[str, NDArray[Any] | bytes] | None" = None) -> None:
        """Sends a JSON object, bytes, and arrays of bool, uint8, float32 or float64 of any shape."""
        kinds: dict[str, list[Any]] = {}
        parts: list[Any] = []
        for name, array in (arrays or {}).items():
            if isinstance(array, bytes):
                kinds[name], part = ["bytes", [len(array)]], memoryview(array)
            else:
                kinds[name], part = [array.dtype.str, list(array.shape)], array.reshape(-1).view("u1").data
            parts.append(part)
        head = json.dumps({**words, "arrays": kinds}).encode()
        try:
            with self._sending:
                self._socket.settimeout(None)
                self._socket.sendall(_LENGTHS.pack(len(head), sum(map(len, parts))) + head)
                for part in parts:  # without a copy: a photograph has millions of bytes
                    self._socket.sendall(part)
        except OSError as error:
            raise ProcessLost(f"The other end of the link is gone ({error}).") from error

    def receive(self, within: float = math.inf) -> tuple[dict[str, Any], Arrays]:
        """Returns the next message: its object and its arrays.

        within: seconds to wait for the whole message
        """
        until = time.monotonic() + within
        words, size = _LENGTHS.unpack(self._exactly(_LENGTHS.size, until))
        if words > _MAX_WORDS or size > _MAX_BYTES:
            raise ProcessLost(f"A message of {words} + {size} bytes came over the link; that is no message.")
        head, body = self._exactly(words, until), self._exactly(size, until)
        try:
            said = json.loads(head)
            return said, _cut(said.pop("arrays"), body)
        except (ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
            raise ProcessLost(f"What came over the link is no message ({error}).") from error

    def waits(self, seconds: float) -> bool:
        """Returns True if a message came, or the other end closed, within `seconds`."""
        with _Selector() as watched:
            watched.register(self._socket, selectors.EVENT_READ)
            return bool(watched.select(seconds))

    def close(self) -> None:
        """Closes this end; the other end notices it."""
        self._socket.close()

    def _exactly(self, count: int, until: float) -> bytearray:
        """Returns the next `count` bytes."""
        content, got = bytearray(count), 0
        room = memoryview(content)
        while got < count:
            # Bytes that are already there are read even if it is late: then this process did not run.
            left = max(until - time.monotonic(), 0.0)
            try:
                self._socket.settimeout(left if math.isfinite(left) else None)
                part = self._socket.recv_into(room[got:])
            except (TimeoutError, BlockingIOError) as nothing:
                if left:
                    continue  # it may have come at the last moment
                raise ProcessLost("The other end of the link did not answer in time.") from nothing
            except OSError as error:
                raise ProcessLost(f"The other end of the link is gone ({error}).") from error
            if not part:
                raise ProcessLost("The other end of the link is gone.")
            got += part
        return content


def _cut(kinds: Mapping[str, Any], body: bytearray) -> Arrays:
    """Returns the arrays of a message. Raises ValueError, KeyError or TypeError if the bytes do not match."""
    arrays: Arrays = {}
    start = 0
    for name, (kind, shape) in kinds.items():
        if kind not in _KINDS or not all(isinstance(side, int) and 0 <= side <= _MAX_BYTES for side in shape):
            raise ValueError(f"array {name} of {kind} and shape {shape}")
        if kind == "bytes":
            end = start + sum(shape)
            arrays[name] = bytes(memoryview(body)[start:end])
        else:
            import numpy as np

            dtype = np.dtype(kind)
            end = start + math.prod(shape) * dtype.itemsize
            part = np.frombuffer(body, np.uint8)[start:end]
            aligned = start % dtype.itemsize == 0
            arrays[name] = (part if aligned else part.copy()).view(dtype).reshape(shape)
        start = end
    if start != len(body):
        raise ValueError(f"{len(body)} bytes of arrays, {start} announced")
    return arrays


# Values as JSON and arrays.


def pack(value: Any, kind: Any, arrays: Arrays) -> Any:
    """Returns a value of a type as plain values; puts its arrays into `arrays` and leaves their names.

    kind: its type; None if it is the value's own
    """
    if value is None and NoneType in get_args(kind):
        return None
    kind = _without_none(kind)
    if kind in (NoneType, bool):
        return bool(value) if kind is bool else None
    if isinstance(value, _loaded("torch", "Tensor")):
        value = value.detach().cpu().numpy()
    if _is_array(kind) or isinstance(value, (bytes, _loaded("numpy", "ndarray"))):
        name = str(len(arrays))
        arrays[name] = value if isinstance(value, bytes) else _array(value)
        return name
    if is_dataclass(value):
        types = get_type_hints(kind if is_dataclass(kind) else type(value))  # a subclass may have more
        return {name: pack(getattr(value, name), types[name], arrays) for name in types}
    if isinstance(value, tuple | list):
        return [pack(one, None, arrays) for one in value]
    if isinstance(value, Path):
        return str(value)
    return value.item() if isinstance(value, _loaded("numpy", "generic")) else value


def _array(value: Any) -> "NDArray[Any]":
    """Returns the array of a value, of a kind that a message can carry."""
    import numpy as np

    array = np.asarray(value, order="C")
    return array if array.dtype.str in _KINDS else array.astype(np.float64)


def unpack(plain: Any, kind: Any, arrays: Arrays) -> Any:
    """Returns the value of a type from plain ones. Raises KeyError, TypeError or ValueError if they do not fit it."""
    if plain is None and NoneType in get_args(kind):
        return None
    kind = _without_none(kind)
    origin, inner = get_origin(kind), get_args(kind)
    if kind is bytes or _is_array(kind):
        array: Any = arrays[plain]
        if isinstance(array, bytes) != (kind is bytes):
            raise TypeError(f"{type(array).__name__} where {kind} belongs")
        if not inner:  # bytes, or a tensor
            return array if kind is bytes else sys.modules["torch"].from_numpy(array)
        (number,) = get_args(inner[1])
        return array if number is Any else array.astype(number, copy=False)
    if is_dataclass(kind):
        types = get_type_hints(kind)
        return kind(**{name: unpack(value, types[name], arrays) for name, value in plain.items()})  # type: ignore[operator]
    if origin is Mapping:
        return {str(name): unpack(value, inner[1], arrays) for name, value in plain.items()}
    if origin is tuple:
        each = inner[:1] * len(plain) if inner[1:] == (...,) else inner
        return tuple(unpack(value, one, arrays) for value, one in zip(plain, each, strict=True))
    if kind in (float, int, str, Path):
        return kind(plain)
    allowed = {NoneType: (None,), bool: (True, False)}.get(kind) or (inner if origin is Literal else ())
    if plain not in allowed:
        raise TypeError(f"{str(plain)[:40]!r} where {kind} belongs")
    return plain


def _without_none(kind: Any) -> Any:
    """Returns the type beside None of a type that may be None; any other type as it is."""
    return next(one for one in get_args(kind) if one is not NoneType) if NoneType in get_args(kind) else kind


def _is_array(kind: Any) -> bool:
    return kind is _loaded("torch", "Tensor") or get_origin(kind) is _loaded("numpy", "ndarray")


def _loaded(library: str, name: str) -> Any:
    """Returns a class of a library if that is loaded, otherwise ()."""
    return getattr(sys.modules.get(library), name, ())


# Errors.


def encode_error(error: FridaError) -> dict[str, Any]:
    """Returns an error as plain values for the other end, which converts it back with `decode_error`."""
    taken = inspect.signature(type(error).__init__).parameters
    told = {name: value for name, value in vars(error).items() if name in taken}
    plain = {name: value if isinstance(value, int | float | None) else str(value) for name, value in told.items()}
    return {"error": type(error).__name__, "message": str(error), "details": plain}


def decode_error(answer: Mapping[str, Any], otherwise: type[FridaError]) -> FridaError:
    """Returns the error that the other end reported, with its fields; `otherwise` if class or fields are unknown."""
    kind, message = getattr(errors, str(answer["error"]), None), str(answer.get("message", ""))
    if isinstance(kind, type) and issubclass(kind, FridaError):
        with contextlib.suppress(TypeError):
            return kind(message, **answer.get("details", {}))
    return otherwise(message)
