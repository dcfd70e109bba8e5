"""The stroke models that ship with the project, by the name of their brush, and those that a person trained."""

from pathlib import Path

from frida_painter.brush import field, param2stroke
from frida_painter.brush.field import StrokeField
from frida_painter.brush.kinds import KINDS
from frida_painter.brush.model_file import ModelFile
from frida_painter.brush.param2stroke import Param2Stroke
from frida_painter.errors import WeightsError

_KINDS_OF_MODEL: dict[str, type[StrokeField] | type[Param2Stroke]] = {
    field.FORMAT: StrokeField,
    param2stroke.FORMAT: Param2Stroke,
}


def load_stroke_model(brush: str | Path) -> StrokeField | Param2Stroke:
    """The trained stroke model of a brush that comes with the project ("broad"), or of a file of weights.

    Raises WeightsError where the file is missing, damaged or holds something else.
    """
    names = [kind.name for kind in KINDS]
    path = Path(__file__).with_name(f"{brush}.safetensors") if brush in names else Path(brush)
    file = ModelFile.read(path)
    if file.format not in _KINDS_OF_MODEL:
        raise WeightsError(
            f"{path} holds a stroke model of an unknown kind; give a file that this version of "
            "`frida-painter strokes train` wrote."
        )
    return _KINDS_OF_MODEL[file.format].restored(file)
