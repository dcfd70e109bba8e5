import fcntl
import json
import math
import resource
import socket
import struct
import threading
import time
from collections.abc import Iterator

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays
from numpy.typing import NDArray

from frida_painter.errors import (
    CameraError,
    FridaError,
    MotionFailed,
    ProcessLost,
    RobotBusy,
    RobotError,
    RobotStopped,
)
from frida_painter.system.messages import Wire, decode_error, encode_error, pack, unpack

words = st.recursive(
    st.none() | st.booleans() | st.integers(-(2**60), 2**60) | st.floats(allow_nan=False) | st.text(max_size=20),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner, max_size=3),
    max_leaves=6,
)
numbers = st.binary(max_size=9) | st.sampled_from([np.uint8, np.float32, np.float64]).flatmap(
    lambda kind: arrays.arrays(kind, arrays.array_shapes(min_dims=0, max_dims=3, min_side=0, max_side=4))
)


@pytest.fixture
def ends() -> Iterator[tuple[Wire, socket.socket]]:
    one, other = socket.socketpair()
    yield Wire(one), other
    one.close()
    other.close()


@given(
    st.dictionaries(st.text(max_size=8).filter(lambda name: name != "arrays"), words, max_size=4),
    st.dictionaries(st.text(max_size=8), numbers, max_size=3),
)
def test_what_is_sent_is_what_comes(said: dict, sent: dict) -> None:
    one, other = socket.socketpair()
    with one, other:
        Wire(one).send(said, sent)
        heard, received = Wire(other).receive(1)
    assert heard == said and list(received) == list(sent)
    for name, array in sent.items():
        came = received[name]
        assert type(came) is type(array) and bytes(came) == bytes(array)
        assert isinstance(array, bytes) or (came.dtype, came.shape) == (array.dtype, array.shape)


def test_a_server_with_many_open_files_waits_as_well(ends: tuple[Wire, socket.socket]) -> None:
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (hard, hard))
    try:
        with socket.socket(fileno=fcntl.fcntl(ends[1], fcntl.F_DUPFD_CLOEXEC, 1024)) as high:
            assert not Wire(high).waits(0)
            ends[0].send({"n": 1})
            assert Wire(high).waits(0) and Wire(high).receive(1)[0] == {"n": 1}
            ends[0].close()
            assert Wire(high).waits(1), "of its end, too"
    finally:
        resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))


def test_a_photograph_larger_than_any_buffer_comes_whole(ends: tuple[Wire, socket.socket]) -> None:
    wire, other = ends
    image = np.random.default_rng(0).integers(0, 256, (1200, 1600, 3), np.uint8)
    thread = threading.Thread(target=Wire(other).send, args=({"n": 1}, {"image": image}))
    thread.start()
    _, received = wire.receive(10)
    thread.join()
    assert (received["image"] == image).all()


def message(head: bytes, body: bytes = b"") -> bytes:
    return struct.pack("<II", len(head), len(body)) + head + body


@pytest.mark.parametrize(
    "content",
    [
        b"GET / HTTP/1.1\r\n\r\n" + bytes(64),
        message(b"{"),
        message(b"[]"),
        message(b"{}"),
        message(b'{"arrays": 3}'),
        message(b'{"arrays": {"a": ["<f8", [2]]}}', bytes(15)),
        message(b'{"arrays": {"a": ["<f8", [1]]}}', bytes(16)),
        message(b'{"arrays": {"a": ["|O", [1]]}}', bytes(8)),
        message(b'{"arrays": {"a": ["<f8", [-1]]}}'),
        message(b'{"arrays": {"a": ["bytes", [9]]}}', bytes(8)),
        message(b'{"arrays": {"a": ["<f8", ["x"]]}}'),
        message(b'{"arrays": {"a": ["|u1", [99999999, 99999999]]}}'),
        message(b"[" * 100_000),
        message(json.dumps({"arrays": {}}).encode() + b"\xff"),
        struct.pack("<II", 2**31, 0),
        struct.pack("<II", 2, 2**31),
    ],
)
def test_what_is_no_message_is_refused(ends: tuple[Wire, socket.socket], content: bytes) -> None:
    wire, other = ends
    other.sendall(content)
    with pytest.raises(ProcessLost):
        wire.receive(0.2)


@pytest.mark.parametrize("cut", [0, 3, 8, 12])
def test_who_hangs_up_within_a_message_is_gone(ends: tuple[Wire, socket.socket], cut: int) -> None:
    wire, other = ends
    other.sendall(message(b'{"arrays": {}}')[:cut])
    other.close()
    with pytest.raises(ProcessLost, match="gone"):
        wire.receive(1)
    with pytest.raises(ProcessLost, match="gone"):
        for _ in range(10):
            wire.send({"still": "there?"})


def test_who_stays_silent_is_late_and_a_message_that_trickles_in_is_as_well(ends: tuple[Wire, socket.socket]) -> None:
    wire, other = ends
    for begun in (b"", message(b'{"arrays": {}}')[:9]):
        other.sendall(begun)
        began = time.monotonic()
        with pytest.raises(ProcessLost, match="in time"):
            wire.receive(0.05)
        assert time.monotonic() - began < 30, "it does not wait for ever; how busy the machine is is another matter"


def test_nothing_comes_as_nothing_also_in_place_of_an_array() -> None:
    for kind in (NDArray[np.uint8] | None, bytes | None, str | None):
        sent: dict = {}
        assert pack(None, kind, sent) is None and unpack(None, kind, sent) is None and sent == {}


def test_errors_come_as_themselves() -> None:
    for error in (RobotBusy("busy", 7), MotionFailed("failed", "C31", 4), RobotStopped("stopped", asked=True),
                  CameraError("dark"), RobotError("no")):  # fmt: skip
        again = decode_error(encode_error(error), RobotError)
        assert type(again) is type(error) and str(again) == str(error) and vars(again) == vars(error)

    class Foreign(FridaError):
        """Error of another package."""

    assert type(decode_error(encode_error(Foreign("it is theirs")), RobotError)) is RobotError


def test_an_error_with_other_fields_is_a_robot_error() -> None:
    for kind, details in (
        ("RobotBusy", {"pid": 7, "other": 1}), ("RobotAbandoned", {}), ("CameraError", {"code": 1}),
        ("RobotBusy", None), ("annotations", {}),
    ):  # fmt: skip
        again = decode_error({"error": kind, "message": "no", "details": details}, RobotError)
        assert type(again) is RobotError and str(again) == "no"


def test_fields_of_an_error_that_json_has_no_form_of_come_as_text() -> None:
    again = decode_error(json.loads(json.dumps(encode_error(MotionFailed("failed", np.int16(31), math)))), FridaError)  # type: ignore[arg-type]
    assert isinstance(again, MotionFailed) and again.code == "31" and "math" in str(again.waypoint)
