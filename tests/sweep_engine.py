"""An engine for tests of what a sweep makes of one."""

from collections.abc import Callable, Generator, Iterable
from typing import Any

from frida_painter.errors import FridaError
from frida_painter_lab.engine import Ended


class Here:
    """An engine inside this process, for what a sweep makes of an engine. between: is called before every task."""

    slots = 1

    def __init__(self, between: Callable[[Any], None] = lambda task: None) -> None:
        self.between = between
        self.asked: list[Any] = []

    def run(self, work: Callable[[Any], Any], tasks: Iterable[Any]) -> Generator[Ended, None, None]:
        for task in tasks:
            self.asked.append(task)
            try:
                self.between(task)
                work(task)
                yield Ended(task)
            except FridaError as error:
                yield Ended(task, error=error)
