"""The proxy: the methods of an easel's parts, as requests between two processes, all made from their protocols.

Arguments and results travel by the types that the protocols state: numbers, texts, tuples, arrays, tensors and
dataclasses of these. Errors travel by name, sentence and fields. Nothing that comes is executed.
"""

import inspect
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, is_dataclass
from functools import cache
from types import MappingProxyType, NoneType
from typing import Any, Literal, get_args, get_origin, get_type_hints

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from frida_painter import errors
from frida_painter.easel.wire import ARRAY_KINDS
from frida_painter.errors import FridaError, RobotError
from frida_painter.hardware.easel import Operator, PersonCanvas
from frida_painter.hardware.robot import (
    Camera,
    Feeler,
    LimitedRobot,
    PausableRobot,
    Reach,
    Robot,
    TimedRobot,
    ZeroedRobot,
)

Arrays = dict[str, NDArray[Any]]

_PROTOCOLS: Mapping[str, tuple[type, ...]] = MappingProxyType(
    {
        "robot": (Robot, ZeroedRobot, TimedRobot, LimitedRobot, PausableRobot, Feeler),
        "camera": (Camera,),
        "operator": (Operator, PersonCanvas),
        "reach": (Reach,),
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

    def bind(self, *given: Any, **named: Any) -> dict[str, Any]:
        """Returns the arguments of a call by name. Raises TypeError if they do not fit the method."""
        found = self.signature.bind(None, *given, **named).arguments
        return {name: value for name, value in found.items() if name != "self"}

    def pack(self, arguments: Mapping[str, Any]) -> tuple[dict[str, Any], Arrays]:
        """Returns the request as plain values and arrays."""
        arrays: Arrays = {}
        told = {name: pack(value, self.types[name], arrays) for name, value in arguments.items()}
        return {"part": self.part, "do": self.method, "with": told}, arrays

    def answer(self, target: object, told: Mapping[str, Any], arrays: Arrays) -> tuple[dict[str, Any], Arrays]:
        """Calls the method of `target`, and returns its result as plain values and arrays.

        Raises RobotError if `target` does not have it, and the errors of the method.
        """
        if (method := getattr(target, self.method, None)) is None:
            raise _unknown(self.part, self.method)
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
    """Returns the requests of a part by the names of their methods. Raises RobotError if the part is unknown."""
    if part not in _PROTOCOLS:
        raise _unknown(part, "anything")
    return {
        name: Request(part, name, inspect.signature(method), get_type_hints(method))
        for protocol in _PROTOCOLS[part]
        for name, method in vars(protocol).items()
        if inspect.isfunction(method) and not name.startswith("_")
    }


def find_request(words: Mapping[str, Any]) -> Request:
    """Returns the request that came as plain values. Raises RobotError if there is none of that name."""
    part, method = str(words.get("part")), str(words.get("do"))
    found = requests(part).get(method)
    if found is None:
        raise _unknown(part, method)
    return found


def _unknown(part: str, method: str) -> RobotError:
    return RobotError(f"The easel's process was asked for {part + '.' + method!r}, which it does not know.")


class Remote:
    """Part of an easel in another process.

    ask: sends a request with its arguments by name, and returns its result
    """

    def __init__(self, ask: Callable[[Request, Mapping[str, Any]], Any]) -> None:
        self._ask = ask


def make_remote(part: str, base: type[Remote] = Remote) -> Any:
    """Returns a class whose methods are the requests of a part, besides the methods that `base` has itself."""

    def method(request: Request) -> Callable[..., Any]:
        return lambda self, *given, **named: self._ask(request, request.bind(*given, **named))

    rest = {name: method(request) for name, request in requests(part).items() if not hasattr(base, name)}
    return type(f"Remote{part.title()}", (base,), rest)


# Values as JSON and arrays.


def pack(value: Any, kind: Any, arrays: Arrays) -> Any:
    """Returns a value of a type as plain values; puts its arrays into `arrays` and leaves their names."""
    kind = _without_none(kind)
    if kind in (NoneType, bool):
        return bool(value) if kind is bool else None
    if isinstance(value, Tensor):
        value = value.detach().cpu().numpy()
    if _is_array(kind) or isinstance(value, np.ndarray):
        array = np.asarray(value)
        name = str(len(arrays))
        arrays[name] = array if array.dtype.str in ARRAY_KINDS else array.astype(np.float64)
        return name
    if is_dataclass(value):
        types = get_type_hints(kind if is_dataclass(kind) else type(value))  # a subclass may have more
        return {name: pack(getattr(value, name), types[name], arrays) for name in types}
    if isinstance(value, tuple | list):
        return [pack(one, None, arrays) for one in value]
    return value.item() if isinstance(value, np.generic) else value


def unpack(plain: Any, kind: Any, arrays: Arrays) -> Any:
    """Returns the value of a type from plain ones. Raises KeyError, TypeError or ValueError if they do not fit it."""
    if plain is None and NoneType in get_args(kind):
        return None
    kind = _without_none(kind)
    origin, inner = get_origin(kind), get_args(kind)
    if kind is Tensor:
        return torch.from_numpy(arrays[plain])
    if _is_array(kind):
        return arrays[plain].astype(get_args(inner[1])[0], copy=False)
    if is_dataclass(kind):
        types = get_type_hints(kind)
        return kind(**{name: unpack(value, types[name], arrays) for name, value in plain.items()})  # type: ignore[operator]
    if origin is tuple:
        each = inner[:1] * len(plain) if inner[1:] == (...,) else inner
        return tuple(unpack(value, one, arrays) for value, one in zip(plain, each, strict=True))
    if kind in (float, int, str):
        return kind(plain)
    allowed = {NoneType: (None,), bool: (True, False)}.get(kind) or (inner if origin is Literal else ())
    if plain not in allowed:
        raise TypeError(f"{str(plain)[:40]!r} where {kind} belongs")
    return plain


def _without_none(kind: Any) -> Any:
    """Returns the type beside None of a type that may be None; any other type as it is."""
    return next(one for one in get_args(kind) if one is not NoneType) if NoneType in get_args(kind) else kind


def _is_array(kind: Any) -> bool:
    return kind is Tensor or get_origin(kind) is np.ndarray


# Errors.


def encode_error(error: FridaError) -> dict[str, Any]:
    """Returns an error as plain values for the other end, which converts it back with `decode_error`."""
    taken = inspect.signature(type(error).__init__).parameters
    told = {name: value for name, value in vars(error).items() if name in taken}
    plain = {name: value if isinstance(value, int | float | None) else str(value) for name, value in told.items()}
    return {"error": type(error).__name__, "message": str(error), "details": plain}


def decode_error(answer: Mapping[str, Any]) -> FridaError:
    """Returns the error that the other end reported, with its fields; a RobotError if class or fields are unknown."""
    kind, message = getattr(errors, str(answer["error"]), None), str(answer.get("message", ""))
    if isinstance(kind, type) and issubclass(kind, FridaError):
        with suppress(TypeError):
            return kind(message, **answer.get("details", {}))
    return RobotError(message)
