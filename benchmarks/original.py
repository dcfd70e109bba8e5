"""The comparator: one planning iteration built stroke by stroke, as the paper describes its simulation.

"The param2stroke network translates the thickness, bend, and length parameters into a 2d magnitude
map [...]. This magnitude map is then padded such that it is the size of a full canvas. Then the map
is translated and rotated to the specified orientation and location. The magnitude map is converted
into an RGBA image, and then the stroke is applied to a given existing canvas." (FRIDA, ICRA 2023,
"Differentiable Simulated Painting Environment".)

Every stroke is a module of its own and passes the network by itself, in a batch of one. The network
has the paper's layers. The paper does not say how wide they are; here they have widths that occur in
public versions of the original program: 20 hidden numbers, a drawing of 64 x 128 cells, 20 channels.
Speed does not depend on the weights, so they are random.
"""

from typing import Protocol

import torch
from torch import Tensor, nn
from torch.nn import functional

from frida_painter.canvas_size import CanvasSize
from frida_painter.frames import MapFrame
from frida_painter.strokes.strokes import Strokes

HIDDEN, CHANNELS, ROWS, COLUMNS = 20, 20, 64, 128


class Network(Protocol):
    """What turns shapes into maps; the project's own stroke model will do as well."""

    frame: MapFrame

    def __call__(self, thickness: Tensor, length: Tensor, bend: Tensor) -> Tensor: ...


class PaperNetwork(nn.Module):
    """Two linear layers, two convolutions; the upscaler brings the map to the canvas's pixels, see below.

    Input: thickness [1] in [0, 1], length [1] and bend [1] in metres; output: a map [1, 64, 128].
    """

    def __init__(self, frame: MapFrame, *, weight_gradients: bool) -> None:
        super().__init__()
        self.frame = frame.resize(ROWS, COLUMNS)
        self.linear = nn.Sequential(nn.Linear(3, HIDDEN), nn.LeakyReLU(), nn.Linear(HIDDEN, ROWS * COLUMNS))
        self.convolutions = nn.Sequential(
            nn.LeakyReLU(), nn.Conv2d(1, CHANNELS, 3, padding=1), nn.LeakyReLU(), nn.Conv2d(CHANNELS, 1, 3, padding=1)
        )
        self.requires_grad_(weight_gradients)

    def forward(self, thickness: Tensor, length: Tensor, bend: Tensor) -> Tensor:
        shape = torch.stack((thickness, length / self.frame.right, bend / self.frame.top), -1)
        drawing = self.linear(shape).view(-1, 1, ROWS, COLUMNS)
        return torch.sigmoid(self.convolutions(drawing))[:, 0]


class BrushStroke(nn.Module):
    """One stroke, with its seven parameters, that can paint itself over a canvas."""

    def __init__(self, stroke: Strokes) -> None:
        super().__init__()
        self.thickness = nn.Parameter(stroke.thickness.clone())  # [1]
        self.length = nn.Parameter(stroke.length.clone())  # [1]
        self.bend = nn.Parameter(stroke.bend.clone())  # [1]
        self.angle = nn.Parameter(stroke.angle.clone())  # [1]
        self.position = nn.Parameter(stroke.position[0].clone())  # [2]
        self.color = nn.Parameter(stroke.color[0].clone())  # [3]

    def forward(self, canvas: Tensor, size: CanvasSize, network: Network) -> Tensor:
        _, height, width = canvas.shape
        magnitude = network(self.thickness, self.length, self.bend)  # [1, rows, columns]
        padded = padded_to_canvas(magnitude, network.frame, size, height, width)
        grid = functional.affine_grid(self._warp(size)[None], [1, 1, height, width], align_corners=False)
        warped = functional.grid_sample(padded[None], grid, align_corners=False)[0]  # [1, H, W]
        rgba = torch.cat((self.color[:, None, None].expand(3, height, width), warped))
        return rgba[3:] * rgba[:3] + (1 - rgba[3:]) * canvas

    def _warp(self, size: CanvasSize) -> Tensor:
        """From places on the canvas to places on the padded map, both in [-1, 1], [2, 3].

        On the padded map the stroke starts in the middle and heads to the right.
        """
        cos, sin = torch.cos(self.angle[0]), torch.sin(self.angle[0])
        x, y = size.width / 2 - self.position[0], size.height / 2 - self.position[1]
        across = torch.stack((cos, -sin * size.height / size.width, (cos * x + sin * y) * 2 / size.width))
        down = torch.stack((sin * size.width / size.height, cos, (sin * x - cos * y) * 2 / size.height))
        return torch.stack((across, down))


def padded_to_canvas(magnitude: Tensor, frame: MapFrame, size: CanvasSize, height: int, width: int) -> Tensor:
    """The map [1, rows, columns] in the canvas's pixels, on an empty canvas, its start in the middle: [1, H, W]."""
    across, down = size.width / width, size.height / height
    rows, columns = round((frame.top - frame.bottom) / down), round((frame.right - frame.left) / across)
    scaled = functional.interpolate(magnitude[None], (rows, columns), mode="bilinear", align_corners=False)[0]
    left, top = round(width / 2 + frame.left / across), round(height / 2 - frame.top / down)
    return functional.pad(scaled, (left, width - left - columns, top, height - top - rows))


class OriginalPlan(nn.Module):
    """All strokes of a plan, their optimiser, and one iteration of it."""

    def __init__(self, strokes: Strokes, network: Network) -> None:
        super().__init__()
        self.strokes = nn.ModuleList(BrushStroke(strokes[index : index + 1]) for index in range(len(strokes)))
        self.network = (network,)  # in a tuple: not one of this module's parameters
        self.adam = torch.optim.Adam(self.parameters(), lr=1e-3)

    def forward(self, canvas: Tensor, size: CanvasSize) -> Tensor:
        """The picture [3, H, W] that the strokes leave on the canvas."""
        for stroke in self.strokes:
            canvas = stroke(canvas, size, *self.network)
        return canvas

    def iterate(self, canvas: Tensor, size: CanvasSize, target: Tensor) -> float:
        """Render, L2, backward, step; returns the loss before the step."""
        self.adam.zero_grad()
        loss = (self(canvas, size) - target).square().mean()
        loss.backward()
        self.adam.step()
        return loss.item()
