"""Stroke models by brush, of this and other packages, and trained models in files."""

from collections.abc import Iterable
from pathlib import Path

from frida_painter import registry
from frida_painter.brush import field, param2stroke
from frida_painter.brush.field import StrokeField
from frida_painter.brush.kinds import BROAD, FINE, MEDIUM, BrushKind, BrushModel, StrokeModel
from frida_painter.brush.param2stroke import Param2Stroke
from frida_painter.brush.training import ModelFile
from frida_painter.errors import WeightsError
from frida_painter.storage import abridge

_KINDS_OF_MODEL: dict[str, type[StrokeField] | type[Param2Stroke]] = {
    field.FORMAT: StrokeField,
    param2stroke.FORMAT: Param2Stroke,
}


def load_stroke_model(brush: str | Path) -> StrokeModel:
    """Returns the stroke model that is registered for a brush ("broad"), or the one in a file of weights.

    Raises WeightsError if the file is missing or damaged or no stroke model, or if the name is unknown. Raises
    PluginError if the package that registers the brush is broken.
    """
    brushes = registry.parts(registry.STROKE_MODELS)
    registered = brushes.get(str(brush))
    if registered is None and not Path(brush).suffix:  # not a file: the name is misspelt
        raise WeightsError(
            f"{abridge(brush)} is no brush; give {', '.join(brushes)}, or the path of weights (.safetensors) that you "
            "trained."
        )
    return load_weights(Path(brush)) if registered is None else registered.load(BrushModel).load()


def load_stroke_models(brushes: Iterable[str]) -> dict[str, StrokeModel]:
    """Returns the stroke models of brushes by name. Raises the same errors as `load_stroke_model`."""
    return {brush: load_stroke_model(brush) for brush in brushes}


def load_weights(path: Path) -> StrokeField | Param2Stroke:
    """Returns the stroke model in a file of weights.

    Raises WeightsError if it is missing, damaged or of unknown kind.
    """
    file = ModelFile.read(path)
    if file.format not in _KINDS_OF_MODEL:
        raise WeightsError(
            f"{path} holds a stroke model of an unknown kind; give a file that this version of "
            "`frida-painter strokes train` wrote."
        )
    return _KINDS_OF_MODEL[file.format].restore(file)


def _load_shipped(kind: BrushKind) -> BrushModel:
    return BrushModel(kind, lambda: load_weights(Path(__file__).with_name(f"{kind.name}.safetensors")))


FINE_MODEL, MEDIUM_MODEL, BROAD_MODEL = _load_shipped(FINE), _load_shipped(MEDIUM), _load_shipped(BROAD)
