"""Goal "semantic": same content as a picture, as networks see it, instead of the same pixels."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import torch
from torch import Tensor
from torch.nn import functional

from frida_painter.objectives import USUAL_FREEDOM
from frida_painter.objectives.attention import start_from_meaning
from frida_painter.objectives.encoders.base import Seer
from frida_painter.objectives.encoders.convolutional import Vgg16
from frida_painter.objectives.image import PaintedTerm, rise, spread
from frida_painter.objectives.objective import GRADIENT_LASTS, Goal, ObjectiveContext, ObjectiveTerm
from frida_painter.strokes.palette import from_lab, to_lab
from frida_painter.system import images
from frida_painter.system.devices import send_to_device


@dataclass(frozen=True)
class SemanticTerm(PaintedTerm):
    """Term of a goal: paint the content of a picture, not its pixels.

    freedom: how far the colours may leave those of the picture, from 0, hardly, to 1, wild
    """

    freedom: float = USUAL_FREEDOM
    called = "a picture to be painted by its meaning"
    is_loose = True
    initial_order = 2
    interpretation_order = 4

    def free_colors(self, freedom: float) -> SemanticTerm:
        """Returns the term with this freedom of its colours; above 0.5 those of its picture are further apart."""
        return replace(self, image=spread_colors(self.image, freedom), freedom=freedom)

    def prepare(self, context: ObjectiveContext) -> ObjectiveTerm:
        """Returns the difference as networks see it. The validation uses a network that the optimiser does not use."""
        # Only the part that fills the canvas counts as content.
        shown = images.fit(self.image, context.grid.rows, context.grid.columns)
        how = context.seed, context.encoders.shapes(), self.freedom, self.importance
        aside = Semantic(shown, context.encoders.aside(), *how)
        seen = Semantic(shown, context.encoders.meaning(), *how)
        lasts = GRADIENT_LASTS if context.in_style else 1
        return ObjectiveTerm(seen, aside.validation, lasts=lasts, smooth=context.in_style)

    @classmethod
    def interpret(cls, goal: Goal, context: ObjectiveContext) -> Goal:
        """Lets the plan begin with the pixels of the picture, weighted by their importance for its content."""
        return start_from_meaning(goal, context.encoders)


# Augmented views of a picture: noise that fools a network in one view does not in another.

# kornia's augmentations use the global generator instead of a seed, and take twice as long: 54 ms on one core for
# eight views of 224 pixels with gradient, against 25 ms here.
_CLOSEST = 0.65  # share of the picture's sides in the tightest crop
_TILT = 0.12  # largest offset of each corner, of a half side


class Views:
    """Augmentation of pictures with `count` fixed views: the whole picture, then random crops and perspectives.

    size: rows and columns of a view in pixels
    seed: the views are drawn from it once, so a target can be prepared for each view
    wholes: number of views after the first that show the whole picture too, in perspective
    """

    def __init__(self, count: int, size: int, seed: int, wholes: int = 0) -> None:
        generator = torch.Generator().manual_seed(seed)
        crops = [_look(generator, 1.0 if number < wholes else _CLOSEST) for number in range(count - 1)]
        self._maps = torch.stack([torch.eye(3), *crops])  # [count, 3, 3]
        self._wholes = wholes
        self._size = size
        along = (torch.arange(size) + 0.5) / size * 2 - 1
        y, x = torch.meshgrid(along, along, indexing="ij")
        seen = torch.einsum("nij,hwj->nhwi", self._maps, torch.stack((x, y, torch.ones_like(x)), -1))
        self._points = seen[..., :2] / seen[..., 2:]  # [count, size, size, 2]

    def some(self, count: int, generator: torch.Generator) -> Tensor:
        """Returns the numbers [count] of different random views: half of them whole, if whole views were asked for."""
        order = torch.randperm(len(self._maps), generator=generator)
        if not self._wholes:
            return order[:count]
        whole = order <= self._wholes
        first = order[whole][: max(math.ceil(count / 2), count - int((~whole).sum()))]
        return torch.cat((first, order[~whole][: count - len(first)]))

    def of(self, picture: Tensor, which: Tensor) -> Tensor:
        """Returns the views with the numbers `which` [n], on the CPU, of a picture [3, H, W]: [n, 3, size, size]."""
        side = self._size * 5 // 4
        small = functional.interpolate(picture[None], [side, side], mode="bilinear", antialias=True)
        return _sample(small, self._points[which])

    def of_squares(self, picture: Tensor, which: Tensor, places: Sequence[float]) -> Tensor:
        """Returns views of the largest squares of a picture [3, H, W], without distortion: [n, 3, size, size].

        which [n]: numbers of the views, on the CPU
        places: position of each view's square, from the left or upper end (0) to the other (1)
        """
        _, rows, columns = picture.shape
        short = min(rows, columns)
        fine = self._size * 5 / 4 / short
        size = [max(1, round(rows * fine)), max(1, round(columns * fine))]
        small = functional.interpolate(picture[None], size, mode="bilinear", antialias=True)
        square = torch.tensor([short / columns, short / rows])  # half sides of the square, relative to the picture
        along = 2 * torch.tensor(places)[:, None] - 1
        middle = along * (1 - square)  # [n, 2]; 0 along the shorter side
        return _sample(small, self._points[which] * square + middle[:, None, None])


def _sample(small: Tensor, points: Tensor) -> Tensor:
    """Returns a picture [1, 3, h, w], mirrored beyond its edges, at points [n, side, side, 2]: [n, 3, side, side]."""
    grid = send_to_device(points.to(small.dtype), small.device)
    return functional.grid_sample(
        small.expand(len(points), -1, -1, -1), grid, mode="bilinear", padding_mode="reflection", align_corners=False
    )


def _look(generator: torch.Generator, closest: float) -> Tensor:
    """Returns a random homography from the corners of a view, at -1 and 1, to their places in the picture.

    closest: least share of the picture's sides that the view shows
    """
    import cv2

    share, right, down = torch.rand(3, generator=generator).tolist()
    share = closest + (1 - closest) * math.sqrt(share)
    tilt = _TILT * (2 * torch.rand(4, 2, generator=generator) - 1)
    corners = torch.tensor([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
    middle = (1 - share) * torch.tensor([2 * right - 1, 2 * down - 1])
    seen = (corners + tilt) * share + middle
    return torch.from_numpy(cv2.getPerspectiveTransform(corners.numpy(), seen.numpy())).float()


_VIEWS = 12
_AT_A_TIME = 2
_SIDE = 176  # pixels of a side of a view
_LAYERS = ("conv3_3", "conv4_3")  # of the trunk: small shapes, and parts of objects
_PIXELS = 12_500  # pixels of the trunk's input, about 100 x 125
_COLORS = 0.02  # share of the shorter side: blur for the comparison of colours
_HELD = 20.0, 0.2  # weight of colours, relative to the squared difference to a picture: held most, and most free
_FACE, _FACE_HELD = 7.0, 20.0  # importance of a face, relative to the least; weight of its pixels, at any freedom
_FURTHER = 0.2, 2.0, 2.0  # L*, a*, b*: share by which the wildest colours are further apart
_BALANCE = 0.05  # relative to the squared difference to a picture, if both weights are 1


class Semantic:
    """Difference of a picture from a target as networks see them, place by place (paper, Eq. "clip_conv_loss").

    image [3, H, W]: target in [0, 1]
    seer: network whose deep features are compared in augmented views
    seed: seed of the views and of their order
    trunk: network for shapes; with it, shapes and blurred colours are compared as well
    freedom: how far colours may leave those of the picture, from 0, hardly, to 1
    importance [h, w]: importance of each place for shapes and colours, with mean 1; None if uniform

    Freedom and importance count only with a trunk. A face is compared pixel by pixel too: people see a slightly wrong
    face as another person, and these networks do not.

    Features are compared by cosine distance, because the texture of paint scales them all over. Target features
    of each view are computed once. Each call uses two random views.
    """

    def __init__(
        self,
        image: Tensor,
        seer: Seer,
        seed: int,
        trunk: Vgg16 | None = None,
        freedom: float = 0.0,
        importance: Tensor | None = None,
    ) -> None:
        self._seer = seer
        self._trunk = trunk
        self._image = image
        self._held = _HELD[0] ** (1 - freedom) * _HELD[1] ** freedom
        self._importance = importance
        self._views = Views(_VIEWS, _SIDE, seed)
        self._generator = torch.Generator().manual_seed(seed)
        with torch.no_grad():
            self._targets = seer.features(self._views.of(image, torch.arange(_VIEWS)))
            self._shapes = [] if trunk is None else trunk.features(images.resize_to_pixels(image, _PIXELS), _LAYERS)

    def __call__(self, picture: Tensor) -> Tensor:
        """Returns the distance of a picture [3, H, W] in [0, 1] in two random views. Differentiable."""
        return self._distance(picture, torch.randperm(_VIEWS, generator=self._generator)[:_AT_A_TIME])

    def validation(self, picture: Tensor) -> Tensor:
        """Returns the distance in the view of the whole picture; deterministic."""
        return self._distance(picture, torch.zeros(1, dtype=torch.long))

    def _distance(self, picture: Tensor, which: Tensor) -> Tensor:
        total = picture.new_zeros(())
        for seen, targets in zip(self._seer.features(self._views.of(picture, which)), self._targets, strict=True):
            wanted = targets[send_to_device(which, targets.device)].to(seen)
            total = total + (1 - functional.cosine_similarity(seen, wanted, dim=1)).mean()
        if self._trunk is None:
            return _BALANCE * total
        found = self._trunk.features(images.resize_to_pixels(picture, _PIXELS), _LAYERS)
        for shapes, wanted in zip(found, self._shapes, strict=True):
            total = total + self._weigh(1 - functional.cosine_similarity(shapes, wanted.to(shapes), dim=0))
        wanted = self._image.to(picture)
        colors = self._weigh((_blur(picture) - _blur(wanted)).square().mean(0))
        return _BALANCE * total + self._held * colors + _FACE_HELD * self._in_faces((picture - wanted).square().mean(0))

    def _weigh(self, differences: Tensor) -> Tensor:
        """Returns the mean of differences [h, w] of the places of a picture, by their importance."""
        if self._importance is None:
            return differences.mean()
        return (differences * spread(self._importance, *differences.shape).to(differences)).mean()

    def _in_faces(self, differences: Tensor) -> Tensor:
        """Returns the same of the places of faces alone, which matter more than the others; 0 without a face."""
        if self._importance is None:
            return differences.new_zeros(())
        matters = spread(self._importance, *differences.shape).to(differences)
        return (differences * matters * rise(matters, _FACE)).mean()


def spread_colors(picture: Tensor, freedom: float) -> Tensor:
    """Returns a picture [3, H, W] of sRGB whose colours are further apart, around their mean.

    freedom: from 0.5, as they are, to 1, three times as far; less than 0.5 changes nothing
    """
    further = max(0.0, 2 * freedom - 1)
    if not further:
        return picture
    lab = to_lab(picture.permute(1, 2, 0))
    mean = lab.mean((0, 1))
    spread = 1 + further * lab.new_tensor(_FURTHER)
    return from_lab(mean + (lab - mean) * spread).permute(2, 0, 1)


def _blur(picture: Tensor) -> Tensor:
    reach = round(_COLORS * min(picture.shape[1:]))
    return functional.avg_pool2d(picture[None], 2 * reach + 1, 1, reach, count_include_pad=False)[0]
