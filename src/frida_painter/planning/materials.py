"""Materials of a plan: brushes and paints that the settings name, opened, and the settled ground and layers."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Self

from frida_painter.brush.kinds import StrokeModel, kind_of
from frida_painter.brush.table import cached_table
from frida_painter.brush.weights import AnyBrush, load_stroke_model
from frida_painter.errors import ConfigError
from frida_painter.mixing.recipe import ANY_PAINTS, PaintSet
from frida_painter.planning.fields import AUTO, OF_SCENE, rgb
from frida_painter.planning.problem import Region
from frida_painter.planning.settings import PlannerSettings
from frida_painter.strokes.plan import WHITE


@dataclass(frozen=True, eq=False)
class Materials:
    """Materials of a plan, which a planner takes beside its settings.

    models: stroke model of each layer, or one for all layers. The brushes may be the same or different ones.
    layers: number of layers. None: the usual number for the strokes if the goal is a picture, else one.
    shares: share of the strokes for each layer. None: the default ones (planning/settings.py).
    ground: sRGB of the bare canvas.
    darkest: sRGB of the darkest available paint; no stroke is planned darker. None: black.
    paints: paints that the palettes are mixed from. None: every colour.
    region: part of the canvas that strokes keep clear of.
    Raises ConfigError if the numbers of layers, models and shares differ.
    """

    models: tuple[StrokeModel, ...]
    layers: int | None = None
    shares: tuple[float, ...] | None = None
    ground: tuple[float, float, float] = WHITE
    darkest: tuple[float, float, float] | None = None
    paints: PaintSet | None = None
    region: Region | None = None

    def __post_init__(self) -> None:
        layers, models = self.layers, len(self.models)
        if models > 1 and layers not in (None, models):
            raise ConfigError(f"{layers} layers and {models} brushes were given; give one brush for each layer.")
        if self.shares is not None and len(self.shares) != (models if models > 1 else layers or 1):
            raise ConfigError(f"{len(self.shares)} shares of the strokes were given; give one for each layer.")

    @classmethod
    def of(
        cls,
        settings: PlannerSettings,
        brushes: AnyBrush | Sequence[AnyBrush] | None = None,
        learned: Mapping[str, Path] | None = None,
    ) -> Self:
        """Opens what the settings name; the ground is white until a planner has chosen another one.

        brushes: stroke models, one for all layers or one for each, instead of the brushes of the settings.
        learned: weights that an easel learned, by the names of brushes.
        Raises ConfigError, and WeightsError if a named model does not exist.
        """
        chosen = settings if brushes is None else settings.model_copy(update={"brushes": None, "strokes_of": None})
        named = [(learned or {}).get(name, name) for name in settings.brush_names] if brushes is None else brushes
        models, layers = stroke_models(named), chosen.wanted_layers
        return cls(
            models,
            len(models) if len(models) > 1 and layers == 1 else layers,
            settings.shares if brushes is None else None,
            WHITE if (ground := settings.wanted_ground) in (AUTO, OF_SCENE) else rgb(ground),
            darkest := settings.darkest_paint,
            PaintSet.of(settings.paints if settings.palette is None else ANY_PAINTS, darkest),
        )


def stroke_models(given: AnyBrush | Sequence[AnyBrush]) -> tuple[StrokeModel, ...]:
    """Returns the stroke model of each layer, or one for all layers; a name or file gives the table of its model.

    Raises WeightsError if a named model does not exist, ConfigError if two different models are of one kind.
    """
    several = given if isinstance(given, Sequence) and not isinstance(given, str) else (given,)
    named = {str(one): cached_table(load_stroke_model(one)) for one in several if isinstance(one, str | Path)}
    models = tuple(named[str(one)] if isinstance(one, str | Path) else load_stroke_model(one) for one in several)
    if len({id(one) for one in models}) > len(set(map(kind_of, models))):
        raise ConfigError("Two stroke models of one brush were given; all layers of a brush have the same one.")
    return models
