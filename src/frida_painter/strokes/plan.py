"""A plan: strokes in painting order, in layers, with a palette, for one canvas."""

import hashlib
import itertools
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import torch
from numpy.typing import ArrayLike
from torch import Tensor

from frida_painter import registry
from frida_painter.canvas_size import AnyCanvas, CanvasSize
from frida_painter.errors import ConfigError, FamilyError, FridaError, PlanError
from frida_painter.strokes.family import StrokeFamily, Taught, describe_kind
from frida_painter.strokes.palette import AnyColor, Palette, as_color
from frida_painter.strokes.strokes import GROUPS, StrokeLimits, Strokes
from frida_painter.system import storage, tensor_file
from frida_painter.system.storage import count_of

VERSION = 4
_WITHOUT_FAMILIES = 3  # version of a plan without stroke families
_TILTED = 5  # plans of release 0.3 whose brush leans have this version
WHITE = (1.0, 1.0, 1.0)
"""sRGB of an untoned canvas."""
MAX_STROKES = 100_000


@dataclass(frozen=True)
class Layer:
    """Strokes that are painted with one brush from one filling of the wells, on the dry paint of earlier layers.

    strokes: number of strokes
    brush: name of the brush
    limits: limits of the brush, with the family of the strokes
    paints: range (first, end) of the palette's paints that are in the wells. Paint i is in well i - first.
    """

    strokes: int
    brush: str
    limits: StrokeLimits
    paints: tuple[int, int]

    @property
    def kind(self) -> str:
        """Kind of the strokes, by which their stroke model is found: the brush, or brush and family ("fine+comma")."""
        return describe_kind(self.brush, self.limits.family)


@dataclass(frozen=True)
class Plan:
    """Complete description of a painting: strokes, paints, canvas and layers.

    strokes: n strokes in painting order
    palette: paints of all layers
    paint [n]: index of each stroke's colour in the palette
    canvas: size of the canvas
    layers: one or more layers. Within each layer the order starts again with light paints.
    ground: sRGB [3] of the bare canvas
    about: free facts (seed, name of the photograph) that are saved with the plan

    Raises PlanError if the parts do not fit together.

        >>> import frida_painter as fp
        >>> fp.make_planner("photo.jpg", strokes=10, colors=3, render_height=64).plan().save("plan.json")
        >>> len(fp.Plan.load("plan.json"))
        10
    """

    strokes: Strokes
    palette: Palette
    paint: Tensor
    canvas: CanvasSize
    layers: tuple[Layer, ...]
    ground: tuple[float, float, float] = WHITE
    about: tuple[tuple[str, str], ...] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "canvas", CanvasSize.of(self.canvas))
        object.__setattr__(self, "ground", as_color(self.ground))
        counts = self.layer_sizes
        if not counts or sum(counts) != len(self.strokes) or min(counts) < 0:
            raise PlanError(
                f"A plan of {len(self.strokes)} strokes has layers of {', '.join(map(str, counts))} strokes; "
                "together they are as many as the plan has."
            )
        if len(self.paint) != len(self.strokes):
            raise PlanError(
                f"A plan has {len(self.strokes)} strokes and {len(self.paint)} paint numbers; it needs one each."
            )
        if not bool(((self.paint >= 0) & (self.paint < len(self.palette))).all()):
            raise PlanError(f"A plan names a paint outside its palette of {len(self.palette)}; numbers start at 0.")
        if not torch.equal(self.palette.color[self.paint].to(self.strokes.color), self.strokes.color):
            raise PlanError("A plan has a stroke whose colour is not that of its paint; make the plan anew.")
        wells = sorted({layer.paints for layer in self.layers})
        ends = [0, *(end for _, end in wells)]
        if [first for first, _ in wells] != ends[:-1] or ends[-1] != len(self.palette) or len(set(ends)) < len(ends):
            raise PlanError(
                f"The layers of a plan have the paints {wells} of a palette of {len(self.palette)} in their wells; "
                "each paint belongs to the wells of one or more layers that have them all."
            )
        for number, (layer, where) in enumerate(self._slices, 1):
            first, end = layer.paints
            if not bool(((self.paint[where] >= first) & (self.paint[where] < end)).all()):
                raise PlanError(
                    f"Layer {number} of a plan has a stroke in a paint that is not in its wells; plan anew."
                )
            self.strokes[where].check(layer.limits, self.canvas)

    @classmethod
    def of(
        cls,
        strokes: Strokes,
        palette: Palette,
        paint: Tensor,
        *,
        brush: str,
        limits: StrokeLimits,
        canvas: AnyCanvas,
        ground: AnyColor = WHITE,
        about: tuple[tuple[str, str], ...] = (),
    ) -> "Plan":
        """Returns a plan with one layer, in which each stroke has exactly the colour of its paint."""
        colored = strokes.with_groups(color=palette.color[paint].to(strokes.color))
        layer = Layer(len(strokes), brush, limits, (0, len(palette)))
        return cls(colored, palette, paint, CanvasSize.of(canvas), (layer,), as_color(ground), about)

    def __len__(self) -> int:
        return len(self.strokes)

    def __repr__(self) -> str:
        layers = "" if len(self.layers) == 1 else f" in {len(self.layers)} layers"
        paints, brushes = count_of(len(self.palette), "paint"), ", ".join(self.kinds)
        return f"Plan({count_of(len(self), 'stroke')} in {paints}{layers}, {brushes}, on {self.canvas})"

    def _repr_png_(self) -> bytes | None:
        """Returns the plan as a picture, which a notebook shows; None if its brush has no stroke model here."""
        with suppress(FridaError):
            drawn: Any = registry.parts(registry.EXPORTERS)["png"].load(object)  # what draws it lies above this module
            content = drawn.export(self)
            return content if isinstance(content, bytes) else None
        return None

    def edit(
        self,
        *,
        position: ArrayLike | Tensor | None = None,
        angle: ArrayLike | Tensor | None = None,
        length: ArrayLike | Tensor | None = None,
        bend: ArrayLike | Tensor | None = None,
        thickness: ArrayLike | Tensor | None = None,
        color: ArrayLike | Tensor | None = None,
        palette: Palette | Sequence[AnyColor] | Tensor | None = None,
    ) -> "Plan":
        """Returns the plan with other numbers in its strokes, projected to the limits of brush and canvas.

        position [n, 2], angle, length, bend, thickness [n]: new values, or one for all strokes, as in `Strokes`
        color [n, 3]: wanted colours; each stroke gets the nearest paint of its wells
        palette: other paints, as many as before, for the same strokes
        Raises PlanError if an array has another shape or a number that is not finite.

            >>> import frida_painter as fp
            >>> plan = fp.make_planner("photo.jpg", strokes=5, colors=3, render_height=64).plan()
            >>> longer = plan.edit(length=plan.strokes.length * 1.05)
            >>> bool((longer.strokes.length >= plan.strokes.length).all())
            True
        """
        groups: dict[str, Any] = {}
        for name, value in zip(GROUPS, (position, angle, length, bend, thickness, color), strict=True):
            if value is None:
                continue
            before: Tensor = getattr(self.strokes, name)
            try:
                groups[name] = torch.as_tensor(value).detach().to(before).expand(before.shape).clone()
            except (RuntimeError, TypeError, ValueError) as cause:
                shape = tuple(getattr(value, "shape", ()))
                raise PlanError(
                    f"{name} was given in the shape {shape}; {len(self)} strokes need {tuple(before.shape)}."
                ) from cause
            if not bool(groups[name].isfinite().all()):
                raise PlanError(f"{name} was given a number that is not finite; give finite numbers.")
        paints = self.palette if palette is None else palette if isinstance(palette, Palette) else Palette(palette)
        if len(paints) != len(self.palette):
            raise PlanError(f"A palette of {len(paints)} paints was given; this plan has {len(self.palette)}.")
        wanted = groups.pop("color", None)
        paint, strokes = self.paint.clone(), self.strokes.with_groups(**groups)
        found = []
        for layer, where in self._slices:
            first, end = layer.paints
            if wanted is not None and layer.strokes:
                paint[where] = first + Palette(paints.color[first:end]).nearest(wanted[where])
            found.append(strokes[where].project(layer.limits, self.canvas))
        colored = Strokes.join(*found).with_groups(color=paints.color[paint].to(strokes.color))
        return replace(self, strokes=colored, palette=paints, paint=paint)

    @property
    def layer_sizes(self) -> tuple[int, ...]:
        """Number of strokes of each layer."""
        return tuple(layer.strokes for layer in self.layers)

    @property
    def layer(self) -> Tensor:
        """Number of each stroke's layer, from 0: [n]."""
        return torch.repeat_interleave(torch.arange(len(self.layers)), torch.tensor(self.layer_sizes))

    @property
    def brushes(self) -> tuple[str, ...]:
        """Brushes of the plan, each once, in the order of use."""
        return tuple(dict.fromkeys(layer.brush for layer in self.layers))

    @property
    def kinds(self) -> tuple[str, ...]:
        """Kinds of strokes of the plan, each once, in the order of use; see `Layer.kind`."""
        return tuple(dict.fromkeys(layer.kind for layer in self.layers))

    @property
    def families(self) -> tuple[StrokeFamily, ...]:
        """Stroke families of the layers, each once, in the order of use."""
        return tuple(dict.fromkeys(layer.limits.family for layer in self.layers if layer.limits.family is not None))

    @property
    def well(self) -> Tensor:
        """Number of the well, from 0, that holds each stroke's paint while its layer is painted: [n]."""
        firsts = torch.tensor([layer.paints[0] for layer in self.layers])
        return self.paint - firsts.to(self.paint)[self.layer]

    def layer_end(self, painted: int) -> int:
        """Returns how many strokes are painted when the layer of the next stroke is complete, of `painted` now."""
        return next((end for end in itertools.accumulate(self.layer_sizes) if end > painted), len(self))

    def wells(self, layer: Layer) -> Palette:
        """Returns the paints in the wells while `layer` is painted, in the order of the wells."""
        return Palette(self.palette.color[slice(*layer.paints)])

    def part(self, which: slice | list[int]) -> "Plan":
        """Returns a plan of only some of the strokes, in their order. It keeps all layers; a layer may become empty."""
        counts = torch.bincount(self.layer[which], minlength=len(self.layers)).tolist()
        layers = tuple(replace(layer, strokes=count) for layer, count in zip(self.layers, counts, strict=True))
        return replace(self, strokes=self.strokes[which], paint=self.paint[which], layers=layers)

    def by_layer(self) -> list["Plan"]:
        """Returns one plan for each layer; its palette has only the paints in the wells of that layer."""
        return [
            replace(
                self,
                strokes=self.strokes[where],
                palette=self.wells(layer),
                paint=self.paint[where] - layer.paints[0],
                layers=(replace(layer, paints=(0, layer.paints[1] - layer.paints[0])),),
            )
            for layer, where in self._slices
        ]

    def by_paint(self) -> list["Plan"]:
        """Returns one plan for each paint of each layer: layers in their order, paints in that of their wells."""
        places = list(zip(self.layer.tolist(), self.well.tolist(), strict=True))
        return [self.part([at for at, mine in enumerate(places) if mine == place]) for place in sorted(set(places))]

    def by_kind(self) -> list[tuple[str, Strokes]]:
        """Returns the kinds of strokes in the order of use, each with all strokes until the next change of kind."""
        runs = itertools.groupby(self.filled_layers(), lambda part: part.layers[0].kind)
        return [(brush, Strokes.join(*(part.strokes for part in run))) for brush, run in runs]

    def by_wells(self) -> list[tuple[int, "Plan"]]:
        """Returns one entry for each filling of the wells: (number of the first layer, from 1, plan of its strokes).

        Each of these plans has only the strokes, layers and paints of its filling.
        """
        found = []
        for first, end in sorted({layer.paints for layer in self.layers}):
            ours = [layer.paints == (first, end) for layer in self.layers]
            part = self.part(torch.tensor(ours)[self.layer].nonzero().flatten().tolist())
            layers = tuple(replace(each, paints=(0, end - first)) for each in itertools.compress(part.layers, ours))
            palette = Palette(self.palette.color[first:end])
            wells = replace(part, palette=palette, paint=part.paint - first, layers=layers)
            found.append((ours.index(True) + 1, wells))
        return found

    def filled_layers(self) -> list["Plan"]:
        """Returns one plan for each layer that has strokes."""
        return [part for part in self.by_layer() if len(part)]

    def under(self, layer: "Plan") -> "Plan":
        """Returns this plan with another plan of one layer painted on top, for the same canvas.

        If the palette of `layer` is not that of this plan's last layer, the wells are filled again before it.
        """
        first, end = self.layers[-1].paints
        palette, paints = self.palette, layer.palette.color
        if not torch.equal(palette.color[first:end], paints):
            first, palette = len(palette), Palette(torch.cat([palette.color, paints]))
        return replace(
            self,
            strokes=Strokes.join(self.strokes, layer.strokes),
            palette=palette,
            paint=torch.cat([self.paint, layer.paint + first]),
            layers=(*self.layers, replace(layer.layers[0], paints=(first, first + len(paints)))),
        )

    def with_parts(self, parts: Sequence["Plan"]) -> "Plan":
        """Returns the plan with new strokes and paints in its layers that have strokes.

        parts: one plan for each of these layers, in the order of `filled_layers`
        """
        found = iter(parts)
        return self._of_layers([next(found) if len(part) else part for part in self.by_layer()])

    def _of_layers(self, parts: Sequence["Plan"]) -> "Plan":
        """Returns the plan made of `parts`, one plan for each layer, in place of those of `by_layer`.

        If layers share wells, a part with strokes sets their paints.
        """
        wells = {layer.paints: self.wells(layer).color for layer in self.layers}
        wells |= {layer.paints: part.palette.color for layer, part in zip(self.layers, parts, strict=True) if len(part)}
        ends = itertools.accumulate(len(wells[paints]) for paints in sorted(wells))
        paints = {old: (end - len(wells[old]), end) for old, end in zip(sorted(wells), ends, strict=True)}
        pairs = list(zip(self.layers, parts, strict=True))
        return replace(
            self,
            strokes=Strokes.join(*(part.strokes for part in parts)),
            palette=Palette(torch.cat([wells[old] for old in sorted(wells)])),
            paint=torch.cat([part.paint + paints[layer.paints][0] for layer, part in pairs]),
            layers=tuple(replace(layer, strokes=len(part), paints=paints[layer.paints]) for layer, part in pairs),
        )

    @property
    def _slices(self) -> list[tuple[Layer, slice]]:
        """Layers, each with the range of its strokes."""
        ends = itertools.accumulate(self.layer_sizes)
        return [(layer, slice(end - layer.strokes, end)) for layer, end in zip(self.layers, ends, strict=True)]

    def reorder(self, order: Tensor) -> "Plan":
        """Returns the same strokes in another order.

        order [n]: indices of the strokes, each once
        Raises PlanError if an index is missing or repeated, or if strokes change their layer.
        """
        if not torch.equal(order.sort().values, torch.arange(len(self), device=order.device)):
            raise PlanError(f"An order of {len(order)} numbers was given; it names each of {len(self)} strokes once.")
        if not torch.equal(self.layer[order], self.layer):
            raise PlanError("An order was given that mixes the layers of a plan; put each of them in order alone.")
        return replace(self, strokes=self.strokes[order], paint=self.paint[order])

    def followed_by(self, rest: "Plan") -> "Plan":
        """Returns a plan of these strokes, followed by the strokes of `rest`.

        rest: a plan with the same canvas and the same number of layers. A layer with strokes in both plans
        continues in `rest`. A layer without strokes in this plan takes its paints from `rest`. Facts of both plans
        are kept, the later ones if they have one name.
        Raises PlanError if the layers do not fit together.
        """
        if len(self.layers) != len(rest.layers):
            raise PlanError(
                f"A plan of {len(self.layers)} layers was to be followed by one of {len(rest.layers)}; give it as many."
            )
        parts = []
        for mine, more in zip(self.by_layer(), rest.by_layer(), strict=True):
            begun, (layer,) = mine if len(mine) else more, mine.layers
            layer = replace(layer, strokes=len(mine) + len(more), paints=begun.layers[0].paints)
            strokes, paint = Strokes.join(mine.strokes, more.strokes), torch.cat([mine.paint, more.paint])
            parts.append(replace(begun, strokes=strokes, paint=paint, layers=(layer,)))
        facts = dict(self.about) | dict(rest.about)
        return replace(self, about=tuple(facts.items()))._of_layers(parts)

    @property
    def _tensors(self) -> dict[str, Tensor]:
        """All tensors by name. A plan without families has none of them and no codes."""
        taught = self.strokes.taught
        codes = {} if taught is None else {"family": taught.number, "code": taught.code}
        return {**self.strokes.arrays(), **codes, "palette": self.palette.color, "paint": self.paint}

    @property
    def digest(self) -> str:
        """sha256 of all facts that decide how the painting looks."""
        first, counts = self.layers[0], self.layer_sizes
        alike = all(replace(layer, strokes=first.strokes) == first for layer in self.layers)
        if alike and first.paints == (0, len(self.palette)):
            facts = (self.canvas, first.brush, first.limits, self.ground, *((counts,) if len(counts) > 1 else ()))
        else:
            facts = (self.canvas, self.layers, self.ground)
        content = hashlib.sha256(repr(facts).encode())
        for layer in self.layers if self.families else ():
            content.update(b"" if layer.limits.family is None else layer.limits.family.digest.encode())
        for tensor in self._tensors.values():
            content.update(tensor.detach().cpu().contiguous().numpy().tobytes())
        return content.hexdigest()

    def save(self, path: str | Path) -> None:
        """Writes the plan as JSON, and its tensors in a safetensors file beside it that is named by its content.

        The JSON holds the name and the hash of the tensor file. The tensors of a plan that is replaced stay: copies of
        that plan may name them. Raises StorageError.
        """
        path, tensors, families = Path(path), self._tensors, self.families
        for number, family in enumerate(families):
            tensors |= {f"family_{number}_mean": family.mean, f"family_{number}_modes": family.modes}
        beside = path.with_name(f"{path.stem}-{self.digest[:12]}.safetensors")
        sha256 = tensor_file.write_tensors(beside, tensors)
        storage.write_json(
            path,
            {
                "format": "frida-painter plan",
                "version": VERSION if families else _WITHOUT_FAMILIES,
                "canvas_m": [self.canvas.width, self.canvas.height],
                "strokes": len(self),
                "layers": [
                    {
                        "strokes": layer.strokes,
                        "brush": layer.brush,
                        "length_m": list(layer.limits.length),
                        "bend_m": list(layer.limits.bend),
                        "paints": list(layer.paints),
                        **({} if layer.limits.family is None else {"family": families.index(layer.limits.family)}),
                    }
                    for layer in self.layers
                ],
                "palette_srgb": [[round(part, 6) for part in color] for color in self.palette.color.tolist()],
                "ground_srgb": list(self.ground),
                "about": dict(self.about),
                **(
                    {"families": [{"name": one.name, "size_m": list(one.size)} for one in families]} if families else {}
                ),
                "tensors": beside.name,
                "tensors_sha256": sha256,
                "digest": self.digest,
            },
        )

    @classmethod
    def load(cls, path: str | Path) -> "Plan":
        """Reads and checks a plan, or the plan.json of a folder. Raises PlanError that names the fault."""
        path = Path(path)
        if path.is_dir():
            path = path / "plan.json"
        record = storage.read_json(path, "a plan (plan.json)", PlanError)
        if record.get("format") != "frida-painter plan":
            raise PlanError(f"{path} is not a plan; give the plan.json of a painting.")
        if record.get("version") == _TILTED:
            raise PlanError(f"{path} is a plan in which the brush leans, and brushes are upright now; plan anew.")
        if record.get("version") not in (_WITHOUT_FAMILIES, VERSION):
            raise PlanError(
                f"{path} is a plan of version {record.get('version')!r}; this program reads versions "
                f"{_WITHOUT_FAMILIES} and {VERSION}; update it, or plan anew."
            )
        try:
            beside = path.with_name(Path(record["tensors"]).name)
            if record["strokes"] > MAX_STROKES:
                raise PlanError(f"{path} has {record['strokes']} strokes; a plan has at most {MAX_STROKES}.")
            tensors, _ = tensor_file.read_tensors(beside, f"the plan {path.name}", PlanError, record["tensors_sha256"])
            families = [
                StrokeFamily(
                    str(entry["name"]),
                    tensors[f"family_{number}_mean"],
                    tensors[f"family_{number}_modes"],
                    tuple(map(float, entry["size_m"])),  # type: ignore[arg-type]
                )
                for number, entry in enumerate(record.get("families", ()))
            ]
            layers = _layers(record["layers"], families)
            taught = None
            if "code" in tensors:
                used = dict.fromkeys(one.limits.family for one in layers if one.limits.family and one.strokes)
                taught = Taught(tuple(used), tensors["family"], tensors["code"])
            plan = cls(
                strokes=Strokes(**{name: tensors[name] for name in GROUPS}, taught=taught),
                palette=Palette(tensors["palette"]),
                paint=tensors["paint"],
                canvas=CanvasSize(*record["canvas_m"]),
                ground=tuple(record["ground_srgb"]),
                about=tuple(record["about"].items()),
                layers=layers,
            )
        except (KeyError, TypeError, ValueError, AttributeError, IndexError, ConfigError, FamilyError) as cause:
            raise PlanError(f"{path} is a plan with a part missing or out of range ({cause}); make it anew.") from cause
        if plan.digest != record.get("digest"):
            raise PlanError(f"{path} does not belong to the strokes beside it; take the whole folder of one painting.")
        return plan


def _layers(entries: Sequence[dict[str, Any]], families: Sequence[StrokeFamily]) -> tuple[Layer, ...]:
    """Returns the layers of a plan file with these stroke families. Raises ValueError if they are invalid."""
    layers = []
    for entry in entries:
        family = families[entry["family"]] if "family" in entry else None
        limits = StrokeLimits(tuple(entry["length_m"]), tuple(entry["bend_m"]), family)
        layers.append(Layer(entry["strokes"], entry["brush"], limits, tuple(entry["paints"])))
    numbers = (number for layer in layers for number in (layer.strokes, *layer.paints))
    if not layers or any(type(number) is not int for number in numbers):
        raise ValueError(f"layers of {[layer.strokes for layer in layers]} strokes")
    if any(type(layer.brush) is not str or len(layer.paints) != 2 for layer in layers):
        raise ValueError("a layer without a brush or paints")
    return tuple(layers)
