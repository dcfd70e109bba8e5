"""The stroke models that ship with the project, by the name of their brush, and those that a person trained."""

from pathlib import Path

from frida_painter.brush.kinds import KINDS
from frida_painter.brush.param2stroke import Param2Stroke


def load_stroke_model(brush: str | Path) -> Param2Stroke:
    """The trained stroke model of a brush that comes with the project ("broad"), or of a file of weights.

    Raises WeightsError where the file is missing, damaged or holds something else.
    """
    names = [kind.name for kind in KINDS]
    return Param2Stroke.load(Path(__file__).with_name(f"{brush}.safetensors") if brush in names else Path(brush))
