"""The semantic replication objective: show what a picture shows, as networks see it, rather than its pixels."""

import math

import torch
from torch import Tensor
from torch.nn import functional

from frida_painter.devices import sent
from frida_painter.images import sized
from frida_painter.objectives.encoders.base import Seer
from frida_painter.objectives.encoders.vgg import Vgg16

# Looking at a picture from here and there: what is only noise to a network from one side is not so from another.

# kornia.augmentation's random perspectives and crops draw from the global generator, not from a seed of ours, and take
# twice as long: 54 ms of one core for eight views of 224 pixels with their gradient, against 25 ms here.
_CLOSEST = 0.65  # of the picture's sides that the tightest crop still shows
_TILT = 0.12  # by how much, of a half side, each corner may move on its own


class Views:
    """`count` ways of looking at pictures: the first at all of it, the others by random crops and perspectives.

    size: rows and columns of a view, in pixels. The ways are drawn once, from `seed`, so that a
    target can be prepared for each.
    """

    def __init__(self, count: int, size: int, seed: int) -> None:
        generator = torch.Generator().manual_seed(seed)
        whole = torch.eye(3)
        self._maps = torch.stack([whole, *(_look(generator) for _ in range(count - 1))])  # [count, 3, 3]
        self._size = size

    def __len__(self) -> int:
        return len(self._maps)

    def of(self, picture: Tensor, which: Tensor) -> Tensor:
        """picture [3, H, W] as it is seen in the ways numbered `which` [n] (of the CPU), [n, 3, size, size]."""
        side = self._size * 5 // 4
        small = functional.interpolate(picture[None], [side, side], mode="bilinear", antialias=True)
        along = (torch.arange(self._size) + 0.5) / self._size * 2 - 1
        y, x = torch.meshgrid(along, along, indexing="ij")
        points = torch.stack((x, y, torch.ones_like(x)), -1)  # [size, size, 3]
        seen = torch.einsum("nij,hwj->nhwi", self._maps[which], points)
        grid = sent((seen[..., :2] / seen[..., 2:]).to(picture.dtype), picture.device)
        return functional.grid_sample(
            small.expand(len(which), -1, -1, -1), grid, mode="bilinear", padding_mode="reflection", align_corners=False
        )


def _look(generator: torch.Generator) -> Tensor:
    """A homography from the corners of a view, at -1 and 1, to where they lie in the picture."""
    share, right, down = torch.rand(3, generator=generator).tolist()
    share = _CLOSEST + (1 - _CLOSEST) * math.sqrt(share)
    tilt = _TILT * (2 * torch.rand(4, 2, generator=generator) - 1)
    corners = torch.tensor([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
    middle = (1 - share) * torch.tensor([2 * right - 1, 2 * down - 1])
    seen = (corners + tilt) * share + middle
    rows = []
    for (x, y), (u, v) in zip(corners.tolist(), seen.tolist(), strict=True):
        rows += [[x, y, 1, 0, 0, 0, -u * x, -u * y], [0, 0, 0, x, y, 1, -v * x, -v * y]]
    solved = torch.linalg.solve(torch.tensor(rows, dtype=torch.float64), seen.double().flatten())
    return torch.cat((solved, solved.new_ones(1))).reshape(3, 3).float()


_VIEWS = 12
_AT_A_TIME = 2
_SIDE = 176  # pixels of a view
_LAYERS = ("conv3_3", "conv4_3")  # of the trunk: small shapes, and parts of things
_PIXELS = 12_500  # of the picture that the trunk sees, about 100 x 125
_COLORS = 0.02  # of the shorter side: colours are to be right over so much
_HELD = 2.0  # of colours, against the squared difference to a picture
_BALANCE = 0.05  # against the squared difference to a picture, when both have a weight of 1


class Semantic:
    """How differently networks see a picture and a target, place by place (paper, Eq. "clip_conv_loss").

    image [3, H, W] in [0, 1]: what is to be shown; seer: the network whose deep features are
    compared, in augmented views; trunk: where given, the shapes that it sees are compared as well,
    and so are colours, blurred. Features are compared by their direction (cosine distance): paint
    has textures of its own, which make them stronger or weaker all over. What the target looks
    like in each of the views is prepared once. Every call looks in the next two of them, in an
    order drawn from `seed`.
    """

    def __init__(self, image: Tensor, seer: Seer, seed: int, trunk: Vgg16 | None = None) -> None:
        self._seer = seer
        self._trunk = trunk
        self._image = image
        self._views = Views(_VIEWS, _SIDE, seed)
        self._generator = torch.Generator().manual_seed(seed)
        with torch.no_grad():
            self._targets = seer.features(self._views.of(image, torch.arange(_VIEWS)))
            self._shapes = [] if trunk is None else trunk.features(sized(image, _PIXELS), _LAYERS)

    def __call__(self, picture: Tensor) -> Tensor:
        """picture [3, H, W] in [0, 1] -> its distance in two random views; differentiable."""
        return self._distance(picture, torch.randperm(_VIEWS, generator=self._generator)[:_AT_A_TIME])

    def validation(self, picture: Tensor) -> Tensor:
        """The same for all of the picture at once, always the same."""
        return self._distance(picture, torch.zeros(1, dtype=torch.long))

    def _distance(self, picture: Tensor, which: Tensor) -> Tensor:
        total = picture.new_zeros(())
        for seen, targets in zip(self._seer.features(self._views.of(picture, which)), self._targets, strict=True):
            total = total + _apart(seen, targets[sent(which, targets.device)])
        if self._trunk is None:
            return _BALANCE * total
        for shapes, wanted in zip(self._trunk.features(sized(picture, _PIXELS), _LAYERS), self._shapes, strict=True):
            total = total + _apart(shapes[None], wanted[None])
        colors = (_blurred(picture) - _blurred(self._image.to(picture))).square().mean()
        return _BALANCE * total + _HELD * colors


def _apart(seen: Tensor, wanted: Tensor) -> Tensor:
    """The mean cosine distance of maps [n, c, h, w] over all places."""
    return (1 - functional.cosine_similarity(seen, wanted.to(seen), dim=1)).mean()


def _blurred(picture: Tensor) -> Tensor:
    """The picture, each pixel the mean of its neighbourhood."""
    reach = round(_COLORS * min(picture.shape[1:]))
    return functional.avg_pool2d(picture[None], 2 * reach + 1, 1, reach, count_include_pad=False)[0]
