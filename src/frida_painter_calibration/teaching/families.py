"""Stroke models of stroke families: a field learned from photographs, and a ribbon without any.

Both see a place from the nearest part of the path, whatever its shape. A path may cross itself or turn back, so the
nearest part depends on the pressure: of two parts at the same distance, the harder pressed one covers the place.
"""

import json
import math
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple, Self

import torch
from torch import Tensor, nn

from frida_painter import registry
from frida_painter.brush.field import ModelFile, StrokeField
from frida_painter.brush.kinds import BrushKind, FamilyPart, StrokeModel, brush_kind, growth_of, mark_width
from frida_painter.brush.library import StrokeLibrary
from frida_painter.errors import FamilyError, WeightsError
from frida_painter.frames import MapFrame
from frida_painter.strokes.family import CODE_REACH, StrokeFamily
from frida_painter.strokes.strokes import StrokeLimits
from frida_painter.system import tensor_file
from frida_painter.system.storage import abridge
from frida_painter_calibration.teaching.bezier import RibbonShape

FORMAT = "frida-painter family field"
VERSION = 1
_SAMPLES = 160  # along a path
_LIGHTEST, _HARDEST = 0.2, 0.9  # half widths of a plausible mark, as shares of half of the widest one
_PRESSED = (0.15, 0.5, 1.0)  # thicknesses for which the nearest part of a path is found
_FARTHEST = 3.0  # features do not grow beyond this many half widths
_PLACES_AT_ONCE = 2**14
_CELLS_AT_ONCE = 2**16


class TracedPaths(NamedTuple):
    """Paths of k strokes of a family as polylines in metres.

    point [k, s, 2], pressure [k, s]: places in the frames of the strokes, and shares of their thickness
    heading [k, s, 2]: unit vectors along the path
    walked [k, s]: arc length from the start
    turn [k, s]: curvature to the left, 1/m
    """

    point: Tensor
    pressure: Tensor
    heading: Tensor
    walked: Tensor
    turn: Tensor

    @classmethod
    def of(cls, family: StrokeFamily, length: Tensor, code: Tensor) -> Self:
        """Returns the paths of strokes with these sizes [k] and codes [k, codes]. Differentiable."""
        fraction = torch.linspace(0, 1, _SAMPLES, dtype=length.dtype, device=length.device)
        point, pressure = family.trace(fraction, length, code)
        step = point.diff(dim=1)
        far = torch.sqrt(step.square().sum(-1) + 1e-14)  # [k, s - 1]
        walked = nn.functional.pad(far.cumsum(1), (1, 0))
        ahead = torch.cat((step[:, :1], step[:, 1:] + step[:, :-1], step[:, -1:]), 1)
        heading = ahead / torch.sqrt(ahead.square().sum(-1, keepdim=True) + 1e-14)
        bent = heading[:, :-1, 0] * heading[:, 1:, 1] - heading[:, :-1, 1] * heading[:, 1:, 0]
        turn = nn.functional.pad(bent / far, (1, 0))
        return cls(point, pressure, heading, walked, turn)

    def nearest(self, place: Tensor, path: Tensor, half_width: Tensor) -> Tensor:
        """Returns the index of the sample whose ribbon reaches nearest to each place: [m].

        place [m, 2], path [m]: places, and the number of the path of each
        half_width [k, s]: half of the ribbon's width at each sample
        """
        found = [path[:0]]
        with torch.no_grad():
            parts = (torch.split(each, _PLACES_AT_ONCE) for each in (place, path))
            for some, number in zip(*parts, strict=True):
                near = self.point[number]  # [m, s, 2]
                away = torch.hypot(near[..., 0] - some[:, :1], near[..., 1] - some[:, 1:])
                found.append((away - half_width[number]).argmin(1))
        return torch.cat(found)

    def seen_from(self, place: Tensor, path: Tensor, sample: Tensor) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        """Returns the view of places from the path near a sample.

        Returns the distance from the path, the distance to its left, the arc length from the start (below 0 before
        it), all in metres, and the pressure there: [m] each. Differentiable.
        """
        point, heading, walked = (part[path, sample] for part in (self.point, self.heading, self.walked))
        off = place - point
        along = (off * heading).sum(-1)
        left = heading[:, 0] * off[:, 1] - heading[:, 1] * off[:, 0]
        half = self.walked[path, -1] / (_SAMPLES - 1)  # to the neighbours; beyond the ends the path stops
        least = torch.where(sample == 0, 0.0, -half.detach())
        most = torch.where(sample == _SAMPLES - 1, 0.0, half.detach())
        foot = torch.maximum(torch.minimum(along, most), least)
        beyond = along - foot
        away = torch.sqrt(left.square() + beyond.square() + 1e-10)
        beside = (sample + torch.where(along >= 0, 1, -1)).clamp(0, _SAMPLES - 1)
        share = (foot.abs() / half.clamp(min=1e-9)).clamp(0, 1)
        pressure = torch.lerp(self.pressure[path, sample], self.pressure[path, beside], share)
        return away, left, walked + along, pressure


def _cell_places(model: StrokeModel, length: Tensor) -> Tensor:
    """Returns the centres of the cells of strokes of these sizes [n], [n, rows x columns, 2] in metres."""
    growth = growth_of(model, length)
    assert growth is not None
    cell = model.frame.cell_centers(dtype=length.dtype, device=length.device).view(-1, 2)
    return cell * growth[:, None, None]


class FamilyField(StrokeField):
    """Stroke field of a family: the network of `StrokeField`, which sees places from the nearest part of a path.

    mean, modes: the family itself, so that a file of weights is complete
    """

    features = 17
    format, version = FORMAT, VERSION
    mean: Tensor
    modes: Tensor

    def __init__(self, brush: str, frame: MapFrame, limits: StrokeLimits) -> None:
        super().__init__(brush, frame, limits)
        assert limits.family is not None
        self.family = limits.family
        self.half_width = mark_width(self) / 2
        self.register_buffer("mean", self.family.mean.clone())
        self.register_buffer("modes", self.family.modes.clone())

    @torch.no_grad()
    def outside(self, length: Tensor, bend: Tensor) -> Tensor:
        """Returns the distance of cells from the path in metres, [n, rows x columns].

        length [n]: sizes in metres
        bend [n, codes]: codes
        """
        point = TracedPaths.of(self.family, length, bend).point
        away = [torch.cdist(cell, one).amin(1) for cell, one in zip(self.cell_places(length), point, strict=True)]
        return torch.stack(away) if away else length.new_zeros(0, self.frame.rows * self.frame.columns)

    def cell_places(self, length: Tensor) -> Tensor:
        """Returns the centres of the cells of strokes of these sizes [n], [n, rows x columns, 2] in metres."""
        return _cell_places(self, length)

    def recorded_maps(self, library: StrokeLibrary) -> Tensor:
        """Returns the marks of a library on the cells of the strokes' frames, [n, rows, columns] in [0, 1]."""
        growth = growth_of(self, library.shapes()[1])
        assert growth is not None
        return torch.cat([library[one : one + 1].maps(self.frame.scale(float(by))) for one, by in enumerate(growth)])

    def styles(self, thickness: Tensor, length: Tensor, bend: Tensor) -> Tensor:
        """Returns thickness, size and two codes as inputs of the network: [n, 4], each with a range of about 1."""
        code = nn.functional.pad(bend / (2 * CODE_REACH), (0, 2 - bend.shape[1]))
        return torch.cat((thickness[:, None], (length / self.limits.length[1])[:, None], code), 1)

    def views(self, place: Tensor, stroke: Tensor, length: Tensor, bend: Tensor) -> Tensor:
        """Returns the views of places from their strokes: [m, 11], with lengths in half widths of the widest mark.

        place [m, 2]: places in the frame of their strokes
        stroke [m]: number of the stroke of each place
        """
        paths = TracedPaths.of(self.family, length, bend)
        views: list[Tensor] = []
        for thickness in _PRESSED:
            wide = self.half_width * (_LIGHTEST + (_HARDEST - _LIGHTEST) * thickness * paths.pressure)
            sample = paths.nearest(place, stroke, wide)
            away, left, along, pressure = paths.seen_from(place, stroke, sample)
            views += [away, pressure]
            if thickness == _PRESSED[1]:
                turn = paths.turn[stroke, sample]
                middle = [left, along, paths.walked[stroke, -1] - along, turn * self.half_width, pressure]
        scaled = [part / self.half_width for part in (*views[::2], *middle[:3])]
        return torch.stack((*scaled, *middle[3:], *views[1::2]), -1)

    def logits(self, view: Tensor, style: Tensor) -> Tensor:
        """Returns median and mean before the squash [m, 2] for views [m, 11] and styles of their strokes [m, 4]."""
        *away, left, along, ahead, turn, pressure, light, middle, hard = view.unbind(-1)
        thickness, length, first, second = style.unbind(-1)
        # The part of the path that reaches nearest, by the pressure of this stroke.
        reaches = [
            far - (_LIGHTEST + (_HARDEST - _LIGHTEST) * thickness * press)
            for far, press in zip(away, (light, middle, hard), strict=True)
        ]
        beyond = torch.minimum(torch.minimum(reaches[0], reaches[1]), reaches[2]).clamp(max=_FARTHEST)
        inwards = (left * turn).clamp(-1, 1)
        features = torch.stack(
            (
                2 * beyond, away[1].clamp(max=_FARTHEST) - 1, reaches[0].clamp(max=_FARTHEST),
                reaches[2].clamp(max=_FARTHEST), along.clamp(-1, 2) - 0.5, ahead.clamp(-1, 2) - 0.5,
                2 * inwards, turn.abs().clamp(max=2), 2 * pressure - 1, 2 * thickness - 1,
                2 * thickness * pressure - 1, 2 * length - 1.5, 2 * first, 2 * second,
                0.3 * left.clamp(-_FARTHEST, _FARTHEST), 0.3 * turn.clamp(-2, 2), beyond.square().clamp(max=4) - 0.5,
            ),
            -1,
        )  # fmt: skip
        marks: Tensor = self.layers(features)
        return marks

    @classmethod
    def restore(cls, file: ModelFile) -> Self:
        """Returns the model of a file of weights. Raises WeightsError if it is of another kind or does not fit."""
        file.require(FORMAT, VERSION)
        try:
            family = StrokeFamily(file.family, file.tensors["mean"], file.tensors["modes"], file.limits.length)
            model = cls(file.brush, file.frame, replace(file.limits, family=family))
        except (KeyError, FamilyError, RuntimeError, ZeroDivisionError) as cause:
            raise file.misfit(cause) from cause
        file.fill(model)
        try:
            model.spread.require()
        except ValueError as cause:
            raise file.misfit(cause) from cause
        if not (0 < float(model.reach) < 1 and 0 < model.half_width < 1):
            raise file.misfit(ValueError(f"a reach of {float(model.reach)} m"))
        return model


class FamilyRibbon(nn.Module):
    """Analytic stroke model of a family that no robot has painted yet: a ribbon with soft edges along the path.

    kind: brush for the strokes of the family, from `BrushKind.of_family`
    """

    def __init__(self, kind: BrushKind) -> None:
        super().__init__()
        self.brush, self.frame, self.limits = kind.name, kind.frame, kind.limits
        assert kind.limits.family is not None
        self.family = kind.limits.family
        self.ribbon = RibbonShape.typical(kind.width)

    def forward(self, thickness: Tensor, length: Tensor, bend: Tensor) -> Tensor:
        """Returns magnitudes [n, rows, columns] in [0, 1].

        thickness [n]: in [0, 1]
        length [n]: sizes in metres
        bend [n, codes]: codes
        """
        shape, maps = self.ribbon, [length.new_zeros(0, self.frame.rows, self.frame.columns)]
        count = max(1, _CELLS_AT_ONCE // (self.frame.rows * self.frame.columns))

        def half_width(press: Tensor) -> Tensor:
            return 1e-3 * (shape.lightest + (shape.hardest - shape.lightest) * press)

        for press, size, code in zip(*(torch.split(part, count) for part in (thickness, length, bend)), strict=True):
            paths, cell = TracedPaths.of(self.family, size, code), _cell_places(self, size)
            place = cell.flatten(0, 1)
            stroke = torch.arange(len(size), device=length.device).repeat_interleave(cell.shape[1])
            nearest = paths.nearest(place, stroke, half_width(press[:, None] * paths.pressure))
            away, _, _, pressure = paths.seen_from(place, stroke, nearest)
            edge = (0.5 - (away - half_width(press[stroke] * pressure)) / (1e-3 * shape.softness)).clamp(0, 1)
            drawn = shape.opacity * edge * edge * (3 - 2 * edge)
            maps.append(drawn.view(-1, self.frame.rows, self.frame.columns))
        return torch.cat(maps)


# Families by name or file
#
# A registered family is a folder's files: NAME.safetensors with the family itself, and NAME-BRUSH.safetensors with a
# stroke model that was learned from its painted strokes. The weights of such a model hold their family too, so one
# file is enough to paint with a family that a person taught.

_ABOUT = "stroke_family"
_FAMILY_FORMAT, _FAMILY_VERSION = "frida-painter stroke family", 1


def write_family(path: Path, family: StrokeFamily) -> None:
    """Writes a family without a stroke model. Raises StorageError."""
    about = {"format": _FAMILY_FORMAT, "version": _FAMILY_VERSION, "name": family.name, "size_m": list(family.size)}
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
        if (about["format"], about["version"]) != (_FAMILY_FORMAT, _FAMILY_VERSION):
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
    part = _find_registered(source)
    return read_family(Path(source)) if part is None else part.load()


def load_family_model(source: str | Path, brush: str) -> StrokeModel:
    """Returns the stroke model of a family, from a registered name or a file, for a brush.

    It is the learned one if there is one for this brush, else a ribbon along the path.
    Raises FamilyError, WeightsError, and ConfigError if the brush is not known.
    """
    part, family = _find_registered(source), load_family(source)
    path = Path(source) if part is None else part.weights(brush)
    if path is not None and _ABOUT not in tensor_file.read_tensors(path, "a stroke family", FamilyError)[1]:
        learned = FamilyField.restore(ModelFile.read(path))  # the file holds more than a family
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


def _find_registered(source: str | Path) -> FamilyPart | None:
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


_WEIGHTS = Path(__file__).with_name("weights")
COMMA = FamilyPart("comma", _WEIGHTS, "a press that swells, turns and lifts off, 19 to 55 mm")
ZIGZAG = FamilyPart("zigzag", _WEIGHTS, "a fill of seven strokes to and fro, 24 to 89 mm")
FLOURISH = FamilyPart("flourish", _WEIGHTS, "a long calligraphic line, like a bow or an S, 53 to 154 mm")
