"""What every calibration procedure returns."""

from typing import Protocol

from torch import Tensor

from frida_painter.calibration import Calibration


class Finding(Protocol):
    """What a procedure found at an easel; implemented by a frozen dataclass of each procedure."""

    @property
    def sentence(self) -> str:
        """What was found and how exactly, in plain words of one or two lines."""

    @property
    def picture(self) -> Tensor | None:
        """What was found, to look at: sRGB [3, h, w] in [0, 1]; None where there is nothing to see."""

    def enter(self, record: Calibration) -> Calibration:
        """The record with this part renewed, by way of `record.with_<procedure>(...)`."""
