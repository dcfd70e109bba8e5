"""Which network sees what: the best that is at hand for each purpose, loaded when it is first asked for."""

from dataclasses import dataclass
from pathlib import Path

from frida_painter import weights
from frida_painter.objectives.encoders.efficientnet import EfficientNetLite
from frida_painter.objectives.encoders.hed import Hed
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
        self._meaning: EfficientNetLite | None = None
        self._aside: EfficientNetLite | None = None
        self._edges: Hed | None = None
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

    def meaning(self) -> EfficientNetLite:
        """What sees what a picture shows."""
        if self._meaning is None:
            self._meaning = EfficientNetLite(weights.tensors("efficientnet-lite0", self._cache))
            self.choices.append(Choice("meaning", "EfficientNet-Lite0"))
        return self._meaning

    def edges(self) -> Hed:
        """What sees where a picture has edges."""
        if self._edges is None:
            self._edges = Hed(weights.tensors("hed", self._cache))
            self.choices.append(Choice("edges", "HED"))
        return self._edges

    def aside(self) -> EfficientNetLite:
        """What the optimiser never asks, and which says when to stop: the best of the others, or else the same."""
        if self._aside is None:
            other = weights.find("efficientnet-lite2", self._cache)
            if other is None:
                better = "an eye kept aside: frida-painter models fetch efficientnet-lite2"
                self.choices.append(Choice("progress", "EfficientNet-Lite0", better))
                return self.meaning()
            self._aside = EfficientNetLite(weights.tensors("efficientnet-lite2", self._cache))
            self.choices.append(Choice("progress", "EfficientNet-Lite2, kept aside"))
        return self._aside
