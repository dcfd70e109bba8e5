"""Control: how a form, such as the studio's page, asks for a setting."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

Step = float | None
TENTHS = tuple(tenths / 10 for tenths in range(11))


@dataclass(frozen=True)
class Control:
    """Control of a setting in a form.

    label: the setting in a few words. "": the form asks for it only together with others.
    steps: values on a slider, in order.
    words: words for a step, each from this value on, with {:g} for the value.
    options: values to choose from, each with its label and an explanation.
    widget: a special control. "": a slider, choices or a number, by `steps` and `options`.
    beside: kind of goal beside which it is asked for. "": it is for the whole painting.
    needs: what an easel must have so that the setting does something.
    """

    label: str = ""
    steps: Sequence[Step] = ()
    words: Mapping[Step, str] = field(default_factory=lambda: {0: "{:g}"})
    options: Mapping[str, tuple[str, str]] = field(default_factory=dict)
    widget: Literal["", "brushes", "canvas", "families", "goals", "ground", "words"] = ""
    beside: str = ""
    needs: Literal["", "camera", "real paint", "robot"] = ""

    @property
    def kind(self) -> str:
        """Kind of the control: its widget, "slider", "choices" or "number"."""
        return self.widget or ("slider" if self.steps else "choices" if self.options else "number")

    def in_words(self, step: Step) -> str:
        """Returns the words for a step."""
        starts = (each for each in self.words if each is not None and step is not None and each <= step)
        return self.words[max(starts, default=None)].format(step)
