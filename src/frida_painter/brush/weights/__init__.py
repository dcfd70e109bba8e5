"""Stroke models by the name of their brush, ours and those of other packages, and those that a person trained."""

from collections.abc import Iterable
from pathlib import Path

from frida_painter import registry
from frida_painter.brush import field, param2stroke
from frida_painter.brush.field import StrokeField
from frida_painter.brush.kinds import BROAD, FINE, MEDIUM, BrushKind, BrushModel, StrokeModel
from frida_painter.brush.param2stroke import Param2Stroke
from frida_painter.brush.training import ModelFile
from frida_painter.errors import WeightsError
from frida_painter.storage import shown

_KINDS_OF_MODEL: dict[str, type[StrokeField] | type[Param2Stroke]] = {
    field.FORMAT: StrokeField,
    param2stroke.FORMAT: Param2Stroke,
}


def load_stroke_model(brush: str | Path) -> StrokeModel:
    """The stroke model that is registered for a brush ("broad"), or the one in a file of weights.

    Raises WeightsError where the file is missing, damaged or holds something else, and PluginError where the
    package that registers the brush is broken.
    """
    brushes = registry.parts(registry.STROKE_MODELS)
    registered = brushes.get(str(brush))
    if registered is None and not Path(brush).suffix:  # no file: somebody has misspelt a name
        raise WeightsError(
            f"{shown(brush)} is no brush; give {', '.join(brushes)}, or the path of weights (.safetensors) that you "
            "trained."
        )
    return load_weights(Path(brush)) if registered is None else registered.load(BrushModel).load()


def load_stroke_models(brushes: Iterable[str]) -> dict[str, StrokeModel]:
    """The stroke models of brushes by their names. Raises as `load_stroke_model`."""
    return {brush: load_stroke_model(brush) for brush in brushes}


def load_weights(path: Path) -> StrokeField | Param2Stroke:
    """The stroke model in a file of weights. Raises WeightsError where it is missing, damaged or something else."""
    file = ModelFile.read(path)
    if file.format not in _KINDS_OF_MODEL:
        raise WeightsError(
            f"{path} holds a stroke model of an unknown kind; give a file that this version of "
            "`frida-painter strokes train` wrote."
        )
    return _KINDS_OF_MODEL[file.format].restored(file)


def _shipped(kind: BrushKind) -> BrushModel:
    return BrushModel(kind, lambda: load_weights(Path(__file__).with_name(f"{kind.name}.safetensors")))


FINE_MODEL, MEDIUM_MODEL, BROAD_MODEL = _shipped(FINE), _shipped(MEDIUM), _shipped(BROAD)
