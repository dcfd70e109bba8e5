"""Experiment about painting by content (paper, section "High-Level Goals"; people preferred painting by meaning).

Instead of people, a network that no optimiser uses judges the photographed paintings, beside edges and pixels.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar, Self

from torch import Tensor

from frida_painter.objectives import weights
from frida_painter.objectives.encoders.convolutional import EfficientNetLite
from frida_painter.system import images
from frida_painter_lab import measures
from frida_painter_lab.experiment import Notify
from frida_painter_lab.paintings import Comparison, Painted, PaintingWay
from frida_painter_lab.targets import Target

_JUDGE = "efficientnet-lite1"
_SIDE = 240  # pixels of its views


@dataclass(frozen=True, kw_only=True)
class SemanticExperiment(Comparison):
    """Experiment `semantic`: every photograph painted by pixels and by meaning, with the same few strokes.

    Features of the network that judges, VGG16's features as in LPIPS, edges and pixels compare with the photograph.
    """

    NAME = "semantic"
    TITLE = "Photographs painted by meaning and by pixels"
    LABEL = "photograph"
    WAYS = (PaintingWay("by pixels"), PaintingWay("by meaning", "by pixels", kind="semantic"))
    MEASURES: ClassVar[Mapping[str, bool | None]] = {
        "feature distance": False, "LPIPS-like": False, "edge F-score": True, "PSNR, dB": True, "CPU s": None,
    }  # fmt: skip

    seeds: tuple[int, ...] = (0, 1)

    @cached_property
    def seer(self) -> EfficientNetLite:
        """Network that judges. Raises WeightsError if it was not fetched."""
        return EfficientNetLite(weights.tensors(_JUDGE))

    def prepare(self, notify: Notify) -> Self:
        """Returns the experiment, after a check for its network. Raises WeightsError."""
        assert self.seer is not None
        return self

    def figures(self, painted: Painted, picture: Tensor, target: Target) -> Mapping[str, float]:
        """Measures the distances between painting and photograph."""
        wanted = images.fit(target.picture, *picture.shape[1:])
        found = (
            measures.feature_distance(self.seer, picture, wanted, _SIDE),
            measures.perceptual_distance(self.networks.style(), picture, wanted),
            measures.edge_score(picture, wanted),
            measures.psnr(picture, wanted),
            painted.seconds,
        )
        return dict(zip(self.MEASURES, found, strict=True))
