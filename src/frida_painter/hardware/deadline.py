"""A deadline for calls that have none of their own."""

import threading
from collections.abc import Callable
from typing import TypeVar

Answer = TypeVar("Answer")


def within(seconds: float, what: str, call: Callable[[], Answer]) -> Answer:
    """What `call` returns, if it does so within `seconds`. Raises TimeoutError otherwise, and whatever it raises.

    A call that does not return is left behind in a thread, named after `what`, that does not keep the
    program alive.
    """
    answers: list[Answer] = []
    failures: list[BaseException] = []
    done = threading.Event()

    def make() -> None:
        try:
            answers.append(call())
        except BaseException as failure:  # Even what a library raises to end the program is for the caller to judge.
            failures.append(failure)
        done.set()

    threading.Thread(target=make, name=what, daemon=True).start()
    if not done.wait(seconds):
        raise TimeoutError(f"{what} did not return within {seconds:g} s")
    if failures:
        raise failures[0]
    return answers[0]


def one_line(failure: BaseException) -> str:
    """What a library raised, as part of a sentence."""
    text = " ".join(str(failure).split())[:200]
    return f"{type(failure).__name__}: {text}" if text else type(failure).__name__
