"""Stroke models by brush, of this and other packages, and trained models in files."""

from collections.abc import Callable
from pathlib import Path

from frida_painter import registry
from frida_painter.brush.field import FORMAT, ModelFile, StrokeField
from frida_painter.brush.kinds import (
    BROAD,
    FINE,
    MEDIUM,
    BrushKind,
    BrushModel,
    FamilyPart,
    StrokeModel,
    require_stroke_model,
)
from frida_painter.brush.table import StrokeTable
from frida_painter.errors import PluginError, WeightsError
from frida_painter.registry import Later
from frida_painter.strokes.plan import Plan
from frida_painter.system.storage import abridge

_FORMATS: dict[str, Callable[[ModelFile], StrokeModel]] = {
    FORMAT: StrokeField.restore,
    "frida-painter family field": Later("frida_painter_calibration.teaching.families:FamilyField.restore"),
    "frida-painter param2stroke": Later("frida_painter_calibration.teaching.param2stroke:Param2Stroke.restore"),
}
"""Readers of the files of weights, by their format."""
_family_model = Later("frida_painter_calibration.teaching.families:load_family_model")
_model_of_family = Later("frida_painter_calibration.teaching.families:family_model_of")
_OURS = (StrokeTable, StrokeField)  # made here, from models that were tried

AnyBrush = StrokeModel | str | Path
"""Brush as public functions take it: its name, a file of weights, or a stroke model."""


def load_stroke_model(brush: AnyBrush) -> StrokeModel:
    """Returns the stroke model that is registered for a brush ("broad"), or the one in a file of weights.

    A stroke model of yours is tried and returned as it is.

    "fine+comma" is the stroke model of the family "comma" for the brush "fine"; a family may be a file too.
    Raises WeightsError if the file is missing or damaged, if the name is unknown, or if the stroke model has wrong
    maps or marks nothing (`require_stroke_model`). Raises FamilyError if a family is unknown or damaged, and
    PluginError if the package that registers the brush is broken.

        >>> import frida_painter as fp
        >>> model = fp.load_stroke_model("broad")
        >>> model.brush, model.limits.length  # metres
        ('broad', (0.012, 0.075))
    """
    if not isinstance(brush, str | Path):
        if isinstance(brush, _OURS):
            return brush
        return require_stroke_model(brush, f"A {type(brush).__name__} that was given as a stroke model")
    brushes = registry.parts(registry.STROKE_MODELS)
    registered = brushes.get(str(brush))
    first, plus, family = str(brush).partition("+")
    if plus and first in brushes and registered is None:
        return _family_model(family, first)
    if registered is None and not Path(brush).suffix:  # not a file: the name is misspelt
        raise WeightsError(
            f"{abridge(brush)} is no brush; give {', '.join(brushes)}, or the path of weights (.safetensors) that you "
            "trained."
        )
    if registered is None:
        return require_stroke_model(load_weights(Path(brush)), f"The stroke model in {abridge(brush)}")
    model = registered.load(BrushModel).load()
    if registered.is_ours:
        return model
    return require_stroke_model(model, f"The stroke model {registered.name!r} of {registered.packages[0]}", PluginError)


def weights_of(brush: str) -> tuple[Path, ...]:
    """Returns the files of weights of a brush, "fine+comma" or a file; none for a brush that another package computes.

    Raises WeightsError for an unknown name.
    """
    first, _, family = brush.partition("+")
    registered = registry.parts(registry.STROKE_MODELS).get(first)
    if registered is None:
        if not Path(first).suffix:
            raise WeightsError(f"{abridge(brush)} is no brush here; install the package that registers it.")
        return (Path(first),)
    if not registered.is_ours:
        return ()
    if not family:
        return (Path(__file__).with_name(f"{first}.safetensors"),)
    if Path(family).suffix:
        return (Path(family),)
    known = registry.parts(registry.STROKE_FAMILIES)
    if family not in known:
        raise WeightsError(f"{abridge(family)} is no stroke family here; install the package that registers it.")
    part = known[family].load(FamilyPart)
    return tuple(filter(None, (part.file, part.weights(first))))


def load_models_of(plan: Plan) -> dict[str, StrokeModel]:
    """Returns the stroke models of a plan by the kind of its strokes (`Layer.kind`).

    Raises the same errors as `load_stroke_model`.
    """
    return {
        layer.kind: load_stroke_model(layer.brush)
        if layer.limits.family is None
        else _model_of_family(layer.limits.family, layer.brush)
        for layer in plan.layers
    }


def load_weights(path: Path) -> StrokeModel:
    """Returns the stroke model in a file of weights.

    Raises WeightsError if it is missing, damaged or of unknown kind.
    """
    file = ModelFile.read(path)
    if file.format not in _FORMATS:
        raise WeightsError(
            f"{path} holds a stroke model of an unknown kind; give a file that this version of "
            "`frida-painter strokes train` wrote."
        )
    return _FORMATS[file.format](file)


def _load_shipped(kind: BrushKind) -> BrushModel:
    return BrushModel(kind, lambda: load_weights(Path(__file__).with_name(f"{kind.name}.safetensors")))


FINE_MODEL, MEDIUM_MODEL, BROAD_MODEL = _load_shipped(FINE), _load_shipped(MEDIUM), _load_shipped(BROAD)
