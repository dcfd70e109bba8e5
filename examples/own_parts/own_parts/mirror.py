"""A kind of goal: the painting is its own mirror image, left to right or top to bottom."""

from dataclasses import dataclass

from torch import Tensor

from frida_painter.plugins import ConfigError, Gives, GoalKind, ObjectiveContext, ObjectiveTerm, Term, require_weight

AXES = {"left-right": 2, "top-bottom": 1}


@dataclass(frozen=True)
class MirrorTerm(Term):
    """axis: "left-right" or "top-bottom"; weight > 0. Raises ConfigError."""

    axis: str = "left-right"
    weight: float = 1.0

    def __post_init__(self) -> None:
        require_weight(self.weight, "a mirror")
        if self.axis not in AXES:
            raise ConfigError(f"A mirror {self.axis[:40]!r} was asked for; it is one of {', '.join(AXES)}.")

    def prepare(self, context: ObjectiveContext) -> ObjectiveTerm:
        """The mean squared difference between the picture [3, H, W] and its mirror image."""

        def difference(picture: Tensor) -> Tensor:
            return (picture - picture.flip(AXES[self.axis])).square().mean()

        return ObjectiveTerm(difference)


KIND = GoalKind(
    name="mirror",
    gives=Gives.WORDS,
    help="Make the painting its own mirror image: left-right or top-bottom.",
    label="Mirror image",
    open=MirrorTerm,
)
