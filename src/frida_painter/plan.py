"""A plan: strokes in painting order, each in one colour of a palette, on a canvas, for a brush."""

import hashlib
import itertools
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from frida_painter import storage, tensor_file
from frida_painter.errors import ConfigError, PlanError
from frida_painter.frames import CanvasSize
from frida_painter.palette import Palette
from frida_painter.strokes import GROUPS, StrokeLimits, Strokes

VERSION = 2
WHITE = (1.0, 1.0, 1.0)
"""sRGB of a canvas that nobody has toned."""
MOST_STROKES = 100_000


@dataclass(frozen=True)
class Plan:
    """What is to be painted.

    strokes: n strokes in painting order; paint [n]: index of each stroke's colour in the palette;
    limits: what the brush can do; ground [3]: sRGB of the bare canvas; about: free facts (seed,
    name of the photograph) that are kept with the plan; layers: how many strokes each layer has, by
    default all of them in one; each layer is painted on the dry paint of those before it, and begins
    light again. Raises PlanError where the parts do not fit.
    """

    strokes: Strokes
    palette: Palette
    paint: Tensor
    canvas: CanvasSize
    brush: str
    limits: StrokeLimits
    ground: tuple[float, float, float] = WHITE
    about: tuple[tuple[str, str], ...] = ()
    layers: tuple[int, ...] = ()

    def __post_init__(self) -> None:
        if not self.layers:
            object.__setattr__(self, "layers", (len(self.strokes),))
        if sum(self.layers) != len(self.strokes) or min(self.layers) < 0:
            raise PlanError(
                f"A plan of {len(self.strokes)} strokes has layers of {', '.join(map(str, self.layers))} strokes; "
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
        self.strokes.check(self.limits, self.canvas)

    @classmethod
    def of(cls, strokes: Strokes, palette: Palette, paint: Tensor, **rest: Any) -> "Plan":
        """The plan of these strokes, each given exactly the colour of its paint."""
        return cls(strokes.with_groups(color=palette.color[paint].to(strokes.color)), palette, paint, **rest)

    def __len__(self) -> int:
        return len(self.strokes)

    @property
    def layer(self) -> Tensor:
        """The number of each stroke's layer, from 0, [n]."""
        return torch.repeat_interleave(torch.arange(len(self.layers)), torch.tensor(self.layers))

    def layer_end(self, painted: int) -> int:
        """How many strokes are painted when the layer of the next stroke is done, `painted` being painted now."""
        return next((end for end in itertools.accumulate(self.layers) if end > painted), len(self))

    def part(self, which: slice | list[int]) -> "Plan":
        """The plan of some of the strokes only, in their order; it has the same layers, of which some may be empty."""
        layers = torch.bincount(self.layer[which], minlength=len(self.layers))
        return replace(self, strokes=self.strokes[which], paint=self.paint[which], layers=tuple(layers.tolist()))

    def by_layer(self) -> list["Plan"]:
        """The plan of each layer alone."""
        ends = list(itertools.accumulate(self.layers))
        return [
            replace(self.part(slice(end - count, end)), layers=(count,))
            for count, end in zip(self.layers, ends, strict=True)
        ]

    def under(self, layer: "Plan") -> "Plan":
        """This plan with all strokes of another as one more layer; palette and canvas are the same."""
        strokes, paint = Strokes.join(self.strokes, layer.strokes), torch.cat([self.paint, layer.paint])
        return replace(self, strokes=strokes, paint=paint, layers=(*self.layers, len(layer)))

    def reordered(self, order: Tensor) -> "Plan":
        """The same strokes in another order: order [n] names each once."""
        if not torch.equal(order.sort().values, torch.arange(len(self), device=order.device)):
            raise PlanError(f"An order of {len(order)} numbers was given; it names each of {len(self)} strokes once.")
        if not torch.equal(self.layer[order], self.layer):
            raise PlanError("An order was given that mixes the layers of a plan; put each of them in order alone.")
        return replace(self, strokes=self.strokes[order], paint=self.paint[order])

    def followed_by(self, rest: "Plan") -> "Plan":
        """These strokes, and after them those of `rest`, a plan with the same palette, canvas and layers.

        A layer that both have strokes of goes on in `rest`. Raises PlanError where layers do not follow each other.
        """
        if len(self.layers) != len(rest.layers):
            raise PlanError(
                f"A plan of {len(self.layers)} layers was to be followed by one of {len(rest.layers)}; give it as many."
            )
        strokes, paint = Strokes.join(self.strokes, rest.strokes), torch.cat([self.paint, rest.paint])
        layers = tuple(mine + more for mine, more in zip(self.layers, rest.layers, strict=True))
        return replace(self, strokes=strokes, paint=paint, layers=layers)

    @property
    def digest(self) -> str:
        """sha256 over everything that decides what is painted."""
        layers = (self.layers,) if len(self.layers) > 1 else ()  # a plan of version 1 keeps its digest
        content = hashlib.sha256(repr((self.canvas, self.brush, self.limits, self.ground, *layers)).encode())
        for tensor in (*self.strokes.arrays().values(), self.palette.color, self.paint):
            content.update(tensor.detach().cpu().contiguous().numpy().tobytes())
        return content.hexdigest()

    def save(self, path: str | Path) -> None:
        """Writes `path` (JSON) and beside it the tensors (safetensors, named by their content).

        The JSON names the tensors' file and its hash, so that a crash between the two writes
        leaves the plan that was there before. Raises StorageError.
        """
        path = Path(path)
        tensors = {**self.strokes.arrays(), "palette": self.palette.color, "paint": self.paint}
        beside = path.with_name(f"{path.stem}-{self.digest[:12]}.safetensors")
        sha256 = tensor_file.write_tensors(beside, tensors)
        storage.write_json(
            path,
            {
                "format": "frida-painter plan",
                "version": VERSION,
                "canvas_m": [self.canvas.width, self.canvas.height],
                "strokes": len(self),
                "layers": list(self.layers),
                "palette_srgb": [[round(part, 6) for part in color] for color in self.palette.color.tolist()],
                "brush": self.brush,
                "limits": {"length_m": list(self.limits.length), "bend_m": list(self.limits.bend)},
                "ground_srgb": list(self.ground),
                "about": dict(self.about),
                "tensors": beside.name,
                "tensors_sha256": sha256,
                "digest": self.digest,
            },
        )
        for old in path.parent.glob(f"{path.stem}-*.safetensors"):
            if old != beside:
                old.unlink(missing_ok=True)

    @classmethod
    def load(cls, path: str | Path) -> "Plan":
        """Reads a plan and checks all of it. Raises PlanError, naming what is wrong with it."""
        path = Path(path)
        if path.is_dir():
            path = path / "plan.json"
        record = storage.read_json(path, "a plan (plan.json)", PlanError)
        if record.get("format") != "frida-painter plan":
            raise PlanError(f"{path} is not a plan; give the plan.json of a painting.")
        if record.get("version") not in range(1, VERSION + 1):
            raise PlanError(
                f"{path} is a plan of version {record.get('version')!r}; this program reads versions up to {VERSION}; "
                "update it."
            )
        try:
            beside = path.with_name(Path(record["tensors"]).name)
            if record["strokes"] > MOST_STROKES:
                raise PlanError(f"{path} has {record['strokes']} strokes; a plan has at most {MOST_STROKES}.")
            tensors, _ = tensor_file.read_tensors(beside, f"the plan {path.name}", PlanError, record["tensors_sha256"])
            limits = record["limits"]
            plan = cls(
                strokes=Strokes(**{name: tensors[name] for name in GROUPS}),
                palette=Palette(tensors["palette"]),
                paint=tensors["paint"],
                canvas=CanvasSize(*record["canvas_m"]),
                brush=record["brush"],
                limits=StrokeLimits(tuple(limits["length_m"]), tuple(limits["bend_m"])),
                ground=tuple(record["ground_srgb"]),
                about=tuple(record["about"].items()),
                layers=_layers(record),
            )
        except (KeyError, TypeError, ValueError, AttributeError, IndexError, ConfigError) as cause:
            raise PlanError(f"{path} is a plan with a part missing or out of range ({cause}); make it anew.") from cause
        if plan.digest != record["digest"]:
            raise PlanError(f"{path} does not belong to the strokes beside it; take the whole folder of one painting.")
        return plan


def _layers(record: dict[str, Any]) -> tuple[int, ...]:
    """The layers of a plan's file; version 1 knew of one only. Raises ValueError where they are none."""
    if record["version"] == 1:
        return (record["strokes"],)
    layers = tuple(record["layers"])
    if not layers or any(type(count) is not int for count in layers):
        raise ValueError(f"layers of {layers} strokes")
    return layers
