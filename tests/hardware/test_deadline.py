import threading
import time
from typing import Any

import pytest

from frida_painter.errors import CameraError, MotionFailed, RobotDisconnected, RobotError
from frida_painter.hardware.deadline import Caller, LibraryExit, Overdue, in_our_errors, one_line, steady, within
from frida_painter.hardware.interlock import Interlock


def raising(error: BaseException) -> None:
    raise error


def soon() -> float:
    return steady() + 5


def test_a_call_returns_and_raises_as_if_it_were_made_here() -> None:
    caller = Caller("the arm")
    assert caller.call(lambda: 7, soon) == 7
    with pytest.raises(ZeroDivisionError):
        caller.call(lambda: 1 // 0, soon)
    assert caller.call(lambda: threading.current_thread().name, soon) == "the arm"
    caller.end()
    assert caller.call(lambda: 8, soon) == 8, "a later call begins another thread"
    caller.end()


def test_a_call_that_is_overdue_is_given_up_and_no_other_is_made_beside_it() -> None:
    released, caller = threading.Event(), Caller("the arm")
    made: list[str] = []
    with pytest.raises(Overdue, match="the arm did not return in time"):
        caller.call(lambda: released.wait(30), lambda: 0.0)
    with pytest.raises(Overdue):
        caller.call(lambda: made.append("beside it"), lambda: 0.0)
    assert made == []
    released.set()
    caller.call(lambda: made.append("after it"), soon)
    caller.end()
    assert made == ["after it"]


@pytest.mark.parametrize("end", [SystemExit, KeyboardInterrupt])
def test_a_library_that_wants_to_end_the_program_does_not_and_the_caller_goes_on(end: type[BaseException]) -> None:
    caller = Caller("the arm")
    with pytest.raises(LibraryExit) as told:
        caller.call(lambda: raising(end(2)), soon)
    assert isinstance(told.value.__cause__, end)
    assert caller.call(lambda: "still here", soon) == "still here"
    caller.end()


def test_within_so_many_seconds_or_not_at_all() -> None:
    assert within(5, "asking", lambda: 7) == 7
    hanging = threading.Event()
    began = time.monotonic()
    with pytest.raises(Overdue, match="asking did not return in time"):
        within(0.05, "asking", lambda: hanging.wait(30))
    assert time.monotonic() - began < 5
    with pytest.raises(Overdue):
        within(float("nan"), "asking", lambda: hanging.wait(30))
    hanging.set()


@pytest.mark.parametrize(
    ("raised", "error", "says"),
    [
        (Overdue("x"), CameraError, "late"),
        (MotionFailed("as it is"), MotionFailed, "as it is"),
        (OSError("no\n cable"), RobotError, r"failed \(OSError: no cable\)"),
        (TimeoutError(), RobotError, r"failed \(TimeoutError\)"),
        (KeyboardInterrupt("me"), KeyboardInterrupt, "me"),  # of a person who waits here; not a failure of the machine
    ],
)
def test_whatever_is_raised_becomes_an_error_with_a_name(
    raised: BaseException, error: type[BaseException], says: str
) -> None:
    named: Any = {"late": lambda: CameraError("late"), "failed": lambda why: RobotError(f"failed ({why})")}
    assert in_our_errors(lambda: "fine", **named) == "fine"
    with pytest.raises(error, match=says):
        in_our_errors(lambda: raising(raised), **named)
    assert one_line(ValueError("x" * 900)) == "ValueError: " + "x" * 200


def test_an_interlock_lets_nothing_through_after_a_library_failed_was_silent_or_wanted_to_end() -> None:
    released = threading.Event()
    for call, error, says in (
        (lambda: released.wait(30), RobotDisconnected, "pose: the arm did not answer within 0 s"),
        (lambda: raising(SystemExit(2)), RobotError, r"pose: the arm failed \(SystemExit: 2\)"),
        (lambda: 1 // 0, RobotError, "ZeroDivisionError"),
    ):
        interlock = Interlock("the arm")
        interlock.mark_connected()
        with pytest.raises(error, match=says):
            interlock.asking("pose", call, 0.2)
        with pytest.raises(RobotError, match="does not move after its last fault"):
            interlock.require_ready("stroke 1")
    released.set()
