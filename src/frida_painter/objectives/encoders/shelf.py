"""Which network sees what: the best that is at hand for each purpose, loaded when it is first asked for."""

from dataclasses import dataclass
from pathlib import Path

from frida_painter import weights
from frida_painter.objectives.encoders.vgg import Vgg16


@dataclass(frozen=True)
class Choice:
    """A network that was used: for what, which, and the better one that was not at hand, if any, with how to get it."""

    purpose: str
    used: str
    better: str = ""


class Encoders:
    """The networks of one painting.

    cache: the folder of fetched weights, by default the usual one; choices: those used so far.
    Everything that loads raises WeightsError, with the command that mends it, where weights are
    missing or altered.
    """

    def __init__(self, cache: Path | None = None) -> None:
        self._cache = cache
        self._vgg: Vgg16 | None = None
        self.choices: list[Choice] = []

    def style(self) -> Vgg16:
        """What sees style: VGG16 as it was trained on ImageNet, or else the trunk of the edge detector."""
        if self._vgg is None:
            if weights.find("vgg16", self._cache) is not None:
                self._vgg = Vgg16.of_torchvision(weights.tensors("vgg16", self._cache))
                self.choices.append(Choice("style", "VGG16"))
            else:
                self._vgg = Vgg16.of_hed(weights.tensors("hed", self._cache))
                better = "VGG16 as trained on ImageNet: frida-painter models fetch vgg16"
                self.choices.append(Choice("style", "VGG16 trunk of the edge detector HED", better))
        return self._vgg
