"""Steps of planning as they are told: one count through all the optimisations that make a plan."""

from collections.abc import Callable, Sequence
from dataclasses import replace

from frida_painter.planning.optimize import Step
from frida_painter.strokes import Strokes


class StepCount:
    """Adds the iterations of several optimisations up to one count."""

    def __init__(self, notify: Callable[[Step], None], total: int) -> None:
        self._notify = notify
        self._total = total
        self._done = 0

    def begin(self, iterations: int, below: Sequence[tuple[str, Strokes]] = ()) -> Callable[[Step], None]:
        """Where the next `iterations` steps are to be reported; below: each brush and its strokes that lie below."""
        before = self._done
        self._done += iterations

        def tell(step: Step) -> None:
            number = before + step.iteration
            self._notify(replace(step, iteration=number, of=self._total, laid=(*below, *step.laid)))

        return tell


def unheard(step: Step) -> None:
    """Where nobody listens."""


def at_the_end(notify: Callable[[Step], None]) -> Callable[[Step], None]:
    """Where the steps of a second try are to be reported: nobody knew before that there is one."""
    return lambda step: notify(replace(step, iteration=step.of))
