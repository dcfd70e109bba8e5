"""Where the next stroke does the most good: many strokes are proposed, their gain is computed, the best are kept.

For a quadratic objective the best colour of a single stroke and what it gains have a closed form,
so thousands of proposals can be weighed at once on a coarse picture.
"""

from dataclasses import dataclass

import torch
import torch.nn.functional as functional
from torch import Tensor

from frida_painter.brush.stroke_model import StrokeModel
from frida_painter.frames import CanvasSize, PixelGrid
from frida_painter.palette import to_lab
from frida_painter.planning.scene import Scene
from frida_painter.planning.variables import Paints
from frida_painter.render import composite
from frida_painter.strokes import StrokeLimits, Strokes

_CELLS = (16, 26)  # rows and columns at which a proposal's mark is weighed
_PLACES = 12  # in the painting order, between which a new stroke may go


@dataclass(frozen=True)
class Layers:
    """Places in the painting order where one more stroke could go, and what it would find there.

    lightness [k - 1], falling: a stroke darker than the first i of them goes to place i; below
    [k, 3, H, W]: the picture that it would be painted over; open [k, H, W]: the share of light that
    the strokes painted afterwards let through; picture [3, H, W]: all strokes.
    """

    lightness: Tensor
    below: Tensor
    open: Tensor
    picture: Tensor

    def place_of(self, color: Tensor) -> Tensor:
        """Where strokes of these colours [m, 3] go, [m]."""
        return (to_lab(color)[:, :1] < self.lightness).sum(1)


def layers(strokes: Strokes, scene: Scene, *, light_to_dark: bool) -> Layers:
    """The layers of strokes that are in painting order; where any order will do, the one place is on top."""
    magnitude, affine = scene.marks(strokes)
    ends = _ends(strokes, light_to_dark)
    below, picture = [], scene.canvas
    for part in ends:
        picture = composite(magnitude[part], affine[part], strokes.color[part], picture)
        below.append(picture)
    open_above, covering = [], torch.ones_like(scene.canvas)
    for part in reversed(ends):
        open_above.append(covering[0])
        covering = composite(magnitude[part], affine[part], torch.zeros_like(strokes.color[part]), covering)
    if light_to_dark:
        # The canvas itself is a place too: below all strokes.
        below.insert(0, scene.canvas)
        open_above.append(covering[0])
        lightness = to_lab(strokes.color)[[part.stop - 1 for part in ends], 0]
    else:
        lightness = strokes.angle.new_zeros(0)
    return Layers(lightness, torch.stack(below), torch.stack(open_above[::-1]), picture)


def _ends(strokes: Strokes, light_to_dark: bool) -> list[slice]:
    """The strokes cut where another may be put between: everywhere that matters, but not too often."""
    count = min(_PLACES, len(strokes)) if light_to_dark else 1
    return [slice(len(strokes) * i // count, len(strokes) * (i + 1) // count) for i in range(count)]


def propose(error: Tensor, count: int, limits: StrokeLimits, size: CanvasSize, generator: torch.Generator) -> Strokes:
    """`count` strokes of random shapes, whose middles lie where the error [H, W] is large; on its device."""
    _, columns = error.shape
    wanted, error = error, error.cpu()  # the same chances on every device
    chosen = torch.multinomial(error.flatten() + 1e-12, count, replacement=True, generator=generator)
    grid = PixelGrid(size, *error.shape)
    pixel = torch.stack((chosen % columns, chosen // columns), -1).to(error)
    middle = grid.to_canvas(pixel + torch.rand(count, 2, generator=generator) - 0.5)

    def uniform(low: float, high: float) -> Tensor:
        return low + (high - low) * torch.rand(count, generator=generator)

    angle = uniform(-torch.pi, torch.pi)
    length = uniform(*limits.length)
    # A bend beyond a third of the length is a hook, rarely what a picture asks for.
    bend = uniform(-1, 1) * torch.minimum(length / 3, torch.tensor(limits.bend[1]))
    half = torch.stack((torch.cos(angle), torch.sin(angle)), -1) * length[:, None] / 2
    strokes = Strokes(middle - half, angle, length, bend, uniform(0, 1), torch.zeros(count, 3))
    return strokes.project(limits, size).to(wanted.device)


def weigh(
    proposals: Strokes, under: Layers, target: Tensor, paints: Paints | None, scene: Scene
) -> tuple[Tensor, Strokes, Tensor | None]:
    """What each proposal gains: the fall of the summed squared error, in pixels of the target [3, H, W].

    Returns the gains [m], the proposals coloured, and with paints the paint of each [m]. A stroke
    of alpha a changes the picture by o a (c - below), o the share left open above it; with
    r = target - picture, the gain is |r|^2 - |r - o a (c - below)|^2, each pixel by its importance.
    """
    alpha, place = _cells(proposals, scene)
    wanted = _sample(target, place)  # [m, 3, cells]
    residual = wanted - _sample(under.picture, place)
    alpha = alpha[:, None]  # [m, 1, cells]
    matters = torch.ones_like(alpha) if scene.importance is None else _sample(scene.importance[None], place)
    share = alpha * matters
    color = scene.in_paint((share * wanted).sum(2) / share.sum(2).clamp(min=1e-6))
    paint = None
    if paints is not None:
        paint = paints.first + torch.cdist(to_lab(color), to_lab(paints.color[paints.first :])).argmin(1)
        color = paints.color[paint]
    layer = under.place_of(color)
    gain = alpha.new_empty(len(proposals))
    for number in sorted(set(layer.tolist())):
        mine = layer == number
        visible = alpha[mine] * _sample(under.open[number][None], place[mine])
        change = visible * (color[mine][:, :, None] - _sample(under.below[number], place[mine]))
        gain[mine] = (matters[mine] * (2 * residual[mine] * change - change.square())).sum((1, 2))
    return gain * _pixels_per_cell(scene), proposals.with_groups(color=color), paint


def pick(strokes: Strokes, gain: Tensor, count: int, model: StrokeModel) -> Tensor:
    """Indices of up to `count` strokes of the largest gain whose marks keep clear of each other's."""
    strokes, gain = strokes.to("cpu"), gain.cpu()  # one after another is looked at
    middle = strokes.path(torch.tensor([0.5]))[:, 0]
    width = (model.frame.top - model.frame.bottom) / 3
    radius = torch.sqrt(strokes.length * (0.3 + 0.7 * strokes.thickness) * width) / 2
    chosen: list[int] = []
    free = gain > 0
    for index in torch.argsort(gain, descending=True).tolist():
        if len(chosen) == count:
            break
        if not free[index]:
            continue
        chosen.append(index)
        free &= (middle - middle[index]).norm(dim=1) > 0.8 * (radius + radius[index])
    return torch.tensor(chosen, dtype=torch.long)


def _cells(strokes: Strokes, scene: Scene) -> tuple[Tensor, Tensor]:
    """Coarse alpha [m, cells] of each mark, and where its cells lie on the canvas, [m, cells, 2] in [-1, 1]."""
    magnitude = scene.model(strokes.thickness, strokes.length, strokes.bend)
    alpha = functional.interpolate(magnitude[:, None], _CELLS, mode="area")[:, 0].flatten(1)
    centers = scene.model.frame.resized(*_CELLS).cell_centers(dtype=alpha.dtype, device=alpha.device).flatten(0, 1)
    cos, sin = torch.cos(strokes.angle)[:, None], torch.sin(strokes.angle)[:, None]
    x = strokes.position[:, 0:1] + cos * centers[:, 0] - sin * centers[:, 1]
    y = strokes.position[:, 1:2] + sin * centers[:, 0] + cos * centers[:, 1]
    place = torch.stack((2 * x / scene.size.width - 1, 1 - 2 * y / scene.size.height), -1)
    outside = (place.abs() > 1).any(-1)
    return alpha.masked_fill(outside, 0), place


def _sample(picture: Tensor, place: Tensor) -> Tensor:
    """The picture [c, H, W] at places [m, cells, 2] -> [m, c, cells]."""
    found = functional.grid_sample(picture[None], place[None].to(picture), align_corners=False, padding_mode="border")
    return found[0].transpose(0, 1)


def _pixels_per_cell(scene: Scene) -> float:
    grid = PixelGrid(scene.size, *scene.canvas.shape[1:])
    cell, pixel = scene.model.frame.resized(*_CELLS).pitch, grid.pitch
    return cell[0] * cell[1] / (pixel[0] * pixel[1])
