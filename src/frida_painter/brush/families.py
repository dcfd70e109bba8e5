"""Stroke families by name or file, and their stroke models for each brush.

A registered family is a folder's files: NAME.safetensors with the family itself, and NAME-BRUSH.safetensors with a
stroke model that was learned from its painted strokes. The weights of such a model hold their family too, so one
file is enough to paint with a family that a person taught.
"""

import json
import math
from dataclasses import dataclass
from pathlib import Path

from frida_painter import registry, tensor_file
from frida_painter.brush.family_field import FamilyField, FamilyRibbon
from frida_painter.brush.kinds import StrokeModel, brush_kind
from frida_painter.brush.training import ModelFile
from frida_painter.errors import FamilyError, WeightsError
from frida_painter.storage import abridge
from frida_painter.stroke_family import StrokeFamily

_ABOUT = "stroke_family"
_FORMAT, _VERSION = "frida-painter stroke family", 1


@dataclass(frozen=True)
class FamilyPart:
    """Stroke family that is registered under its name (registry.py).

    folder: folder of its files
    help: the stroke in a few words
    """

    name: str
    folder: Path
    help: str = ""

    def load(self) -> StrokeFamily:
        """Returns the family. Raises FamilyError."""
        return read_family(self.folder / f"{self.name}.safetensors")

    def weights(self, brush: str) -> Path | None:
        """Returns the file of the stroke model for a brush; None if nobody has learned one."""
        path = self.folder / f"{self.name}-{brush}.safetensors"
        return path if path.is_file() else None


def write_family(path: Path, family: StrokeFamily) -> None:
    """Writes a family without a stroke model. Raises StorageError."""
    about = {"format": _FORMAT, "version": _VERSION, "name": family.name, "size_m": list(family.size)}
    tensors = {"mean": family.mean, "modes": family.modes}
    tensor_file.write_tensors(path, tensors, {_ABOUT: json.dumps(about)})


def read_family(path: Path) -> StrokeFamily:
    """Returns the family in a file of `write_family`, or in the weights of a family's stroke model.

    Raises FamilyError if the file is missing, damaged or of another kind.
    """
    tensors, metadata = tensor_file.read_tensors(path, "a stroke family", FamilyError)
    if _ABOUT not in metadata:
        try:
            return FamilyField.restore(ModelFile.read(path)).family
        except WeightsError as cause:
            raise FamilyError(
                f"{abridge(path)} holds no stroke family; give a file that `frida-painter teach` wrote."
            ) from cause
    try:
        about = json.loads(metadata[_ABOUT])
        if (about["format"], about["version"]) != (_FORMAT, _VERSION):
            raise ValueError(f"version {about['version']!r}")
        least, most = (float(side) for side in about["size_m"])
        if not math.isfinite(least + most):
            raise ValueError("a size that is not finite")
        return StrokeFamily(str(about["name"]), tensors["mean"], tensors["modes"], (least, most))
    except (KeyError, TypeError, ValueError, RecursionError) as cause:
        raise FamilyError(
            f"{abridge(path)} is a stroke family with a part missing or of another version ({cause}); teach it anew."
        ) from cause


def load_family(source: str | Path) -> StrokeFamily:
    """Returns the family of a registered name ("comma"), or of a file.

    Raises FamilyError if there is none, PluginError if the package that registers it is broken.
    """
    part = _registered(source)
    return read_family(Path(source)) if part is None else part.load()


def load_family_model(source: str | Path, brush: str) -> StrokeModel:
    """Returns the stroke model of a family, from a registered name or a file, for a brush.

    It is the learned one if there is one for this brush, else a ribbon along the path.
    Raises FamilyError, WeightsError, and ConfigError if the brush is not known.
    """
    part, family = _registered(source), load_family(source)
    path = Path(source) if part is None else part.weights(brush)
    if path is not None and _holds_weights(path):
        learned = FamilyField.restore(ModelFile.read(path))
        if (learned.brush, learned.family) == (brush, family):
            return learned
    return FamilyRibbon(brush_kind(brush).of_family(family))


def family_model_of(family: StrokeFamily, brush: str) -> StrokeModel:
    """Returns the stroke model of a plan's family for a brush: the registered one, or a ribbon along the path.

    Raises ConfigError if the brush is not known.
    """
    if family.name in registry.parts(registry.STROKE_FAMILIES):
        model = load_family_model(family.name, brush)
        if model.limits.family == family:
            return model
    return FamilyRibbon(brush_kind(brush).of_family(family))


def _holds_weights(path: Path) -> bool:
    """Returns True if the file holds a stroke model, not a family alone."""
    return _ABOUT not in tensor_file.read_tensors(path, "a stroke family", FamilyError)[1]


def _registered(source: str | Path) -> FamilyPart | None:
    """Returns the registered family of that name; None for a file. Raises FamilyError if it is neither."""
    known = registry.parts(registry.STROKE_FAMILIES)
    if str(source) in known:
        return known[str(source)].load(FamilyPart)
    if not Path(source).suffix:  # not a file: the name is misspelt
        raise FamilyError(
            f"{abridge(source)} is no stroke family; give {', '.join(known)}, or a file that `frida-painter teach` "
            "wrote."
        )
    return None


def _ours(name: str, words: str) -> FamilyPart:
    return FamilyPart(name, Path(__file__).with_name("weights"), words)


COMMA = _ours("comma", "a press that swells, turns and lifts off, 19 to 55 mm")
ZIGZAG = _ours("zigzag", "a fill of seven strokes to and fro, 24 to 89 mm")
FLOURISH = _ours("flourish", "a long calligraphic line, like a bow or an S, 53 to 154 mm")
