"""Painters to compare with, each from its paper and none of them ours: plans for a photograph on a bare white canvas.

`plain`: the algorithm of FRIDA (Schaldenbrand et al., ICRA 2023) as published: random strokes, Adam, no layers.
`greedy`: one stroke after another, each the best of 64 random ones for the picture so far.
`hertzmann`: "Painterly Rendering with Curved Brush Strokes of Multiple Sizes" (A. Hertzmann, SIGGRAPH 1998).
"""

import itertools
import math
from dataclasses import replace

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from frida_painter.canvas_size import CanvasSize
from frida_painter.planning.initialize import best_proposals, uniform
from frida_painter.planning.mixable import make_mixable
from frida_painter.planning.optimize import Adam
from frida_painter.render import render
from frida_painter.runs.run import PaintingRun
from frida_painter.strokes.palette import Palette, to_lab
from frida_painter.strokes.plan import WHITE, Plan
from frida_painter.strokes.strokes import Strokes
from frida_painter.system import images
from frida_painter_lab.benchmark.fitting import PathPiece, assemble, find_brushes, fit_hand_in
from frida_painter_lab.benchmark.hand_in import DrawnStroke, HandIn
from frida_painter_lab.benchmark.suite import Budget

# The plain algorithm. Numbers of iterations, paints and rates are those of the published program
# (github.com/cmubig/Frida, options.py and painting.py, f42fa61); its rates for Adam are the ones it has in a comment.

PLAIN_BRUSH = "medium"
_ITERATIONS = 400
_RATES = {"position": 5e-3, "angle": 1e-2, "color": 5e-3, "bend": 3e-3, "length": 1e-2, "thickness": 1e-2}
"""Step of each parameter: positions as shares of half the canvas, angles in radians, lengths and bends in metres."""
_SHUFFLED = 0.3  # share of the iterations in which every third one shuffles the strokes
_DISCRETE, _ALWAYS = 0.5, 0.9  # shares from which every tenth iteration, and every one, uses a few paints


def plan_plain(run: PaintingRun, target: Tensor, budget: Budget) -> Plan:
    """Returns the plan of the plain algorithm for a photograph [3, H, W], with the brush `PLAIN_BRUSH`.

    Strokes are sampled uniformly and optimised together by Adam towards the mean squared difference. They are sorted
    from light to dark after every iteration, and their colours become the means of clusters, more often towards the
    end.
    """
    planner = run.planner
    model, size = planner.models[PLAIN_BRUSH], planner.size
    limits, generator = model.limits.within(size), torch.Generator().manual_seed(planner.seed)
    rows, columns = planner.fine.rows, planner.fine.columns
    wanted, bare = images.fit(target, rows, columns), torch.ones(3, rows, columns)
    strokes = uniform(budget.strokes, limits, size, generator)
    strokes = strokes.with_groups(color=0.3 + 0.4 * strokes.color)
    scale = {name: torch.tensor(rate) for name, rate in _RATES.items()}
    scale["position"] = scale["position"] * torch.tensor([size.width, size.height]) / 2
    leaves = {name: (values / scale[name]).detach().requires_grad_() for name, values in strokes.arrays().items()}
    optimizers = Adam(list(leaves.values()), (0.9, 0.999))
    order = torch.arange(budget.strokes)
    for iteration in range(_ITERATIONS):
        optimizers.forget_gradients()
        current = strokes.with_groups(taught=None, **{name: leaf * scale[name] for name, leaf in leaves.items()})
        loss = (render(current[order], model, bare, size) - wanted).square().mean()
        torch.autograd.backward(loss)
        optimizers.step(1 - 2 * abs(iteration / _ITERATIONS - 0.5) + 0.005)
        with torch.no_grad():
            strokes = strokes.with_groups(taught=None, **{name: leaf * scale[name] for name, leaf in leaves.items()})
            strokes = strokes.project(limits, size)
            share = iteration / _ITERATIONS
            if (iteration % 10 == 0 and share > _DISCRETE) or share > _ALWAYS:
                palette = Palette.cluster(strokes.color, torch.ones(len(strokes)), budget.paints, planner.seed)
                strokes = strokes.with_groups(color=palette.color[palette.nearest(strokes.color)])
            for name, leaf in leaves.items():
                leaf.copy_(getattr(strokes, name) / scale[name])
            order = torch.argsort(to_lab(strokes.color)[:, 0], descending=True, stable=True)
            if share < _SHUFFLED and iteration % 3 == 0:
                order = torch.randperm(len(order), generator=generator)
    palette = Palette.cluster(strokes.color, torch.ones(len(strokes)), budget.paints, planner.seed)
    paint = palette.nearest(strokes.color)
    if planner.materials.paints is not None:
        uses = torch.bincount(paint, minlength=len(palette)).float()
        mixable = make_mixable(palette.color, uses, planner.materials.paints, 1.0)
        palette = Palette.sort_light_to_dark(mixable.color[torch.unique(mixable.number[paint])])
        paint = palette.nearest(mixable.color[mixable.number[paint]])
    order = torch.argsort(paint, stable=True)
    return Plan.of(
        strokes[order].detach(), palette, paint[order], canvas=size, brush=PLAIN_BRUSH, limits=limits, ground=WHITE
    )


# The greedy painter: a third of the strokes with each brush, the largest first.

GREEDY_BRUSHES = ("broad", "medium", "fine")


@torch.no_grad()
def plan_greedy(run: PaintingRun, target: Tensor, budget: Budget) -> Plan:
    """Returns the greedy painter's plan for a photograph [3, H, W].

    Each stroke is the one of 64 random strokes at errors, in its best colour, that lowers the squared difference most.
    """
    planner = run.planner
    generator = torch.Generator().manual_seed(planner.seed)
    grid, picture = planner.coarse, torch.ones(3, planner.coarse.rows, planner.coarse.columns)
    wanted = images.fit(target, grid.rows, grid.columns)
    brushes, names = find_brushes(planner.size), ("angle", "length", "bend", "thickness")
    pieces, colors = list[PathPiece](), list[Tensor]()
    for part, name in enumerate(GREEDY_BRUSHES):
        widths = brushes[name].sizes.width
        for _ in range(part, budget.strokes, len(GREEDY_BRUSHES)):
            problem = planner.problems.of(picture, grid, name)
            stroke = best_proposals(Strokes.empty(), None, 1, problem, wanted, 64, generator).strokes
            picture = problem.render(stroke)
            angle, length, bend, thickness = (float(getattr(stroke, one)[0]) for one in names)
            width = float(np.interp(thickness, np.linspace(0, 1, len(widths)), widths))
            start = stroke.position[0].double().numpy()
            pieces.append(PathPiece(len(pieces), name, width, start, angle, length, bend, thickness))
            colors.append(stroke.color[0])
    drawing = HandIn(planner.size)
    return assemble(pieces, torch.stack(colors), brushes, drawing, budget.paints, planner.seed)[0]


# Hertzmann 1998, style "Impressionist": brushes of radius R, R/2 and R/4, and the parameters of his table (f_c and f_g
# are 1). His threshold T decides how many strokes there are; here it is the least one that keeps the budget.

_RADII = (0.012, 0.006, 0.003)  # metres: 8, 4 and 2 pixels of his pictures of about 200 mm
_BLUR = 0.5  # f_sigma
_LENGTHS = (4, 16)  # steps of a stroke, each as long as the radius
_THRESHOLDS = (25, 50, 75, 100, 125, 150, 175, 200, 250, 300)  # of 255: his T is 100
_PER_METRE = 1700  # pixels


def plan_hertzmann(run: PaintingRun, target: Tensor, budget: Budget) -> Plan:
    """Returns the plan of Hertzmann's painter for a photograph [3, H, W]; its strokes are fitted as a hand-in."""
    canvas, seed = run.spec.canvas, run.spec.seed
    rows, columns = round(canvas.height * _PER_METRE), round(canvas.width * _PER_METRE)
    pixels = 255 * images.fit(target, rows, columns).permute(1, 2, 0).contiguous().double().numpy()
    drawing = HandIn(canvas)
    for threshold in _THRESHOLDS:
        drawing = HandIn(canvas, tuple(paint_hertzmann(pixels, threshold, canvas, seed)))
        if 0 < len(drawing.strokes) <= budget.strokes:
            made, _ = fit_hand_in(drawing, replace(budget, strokes=10 * budget.strokes), seed)
            if len(made) <= budget.strokes:
                return made
    return fit_hand_in(drawing, budget, seed)[0]


def paint_hertzmann(pixels: NDArray[np.float64], threshold: float, canvas: CanvasSize, seed: int) -> list[DrawnStroke]:
    """Returns the strokes of Hertzmann's painter, from the largest brush to the smallest.

    pixels: [rows, columns, 3] in [0, 255]
    """
    random = np.random.default_rng(seed)
    painted = np.full_like(pixels, 255.0)
    pitch = canvas.width / pixels.shape[1]
    found: list[DrawnStroke] = []
    for number, metres in enumerate(_RADII):
        radius = metres / pitch
        reference: NDArray[np.float64] = np.asarray(cv2.GaussianBlur(pixels, (0, 0), _BLUR * radius), np.float64)
        grey = reference @ (0.30, 0.59, 0.11)
        slope = np.stack([cv2.Sobel(grey, cv2.CV_64F, *axis) for axis in ((1, 0), (0, 1))], -1, dtype=np.float64)
        difference = np.sqrt(np.square(reference - painted).sum(-1))
        layer, step = [], max(1, round(radius))
        for top, left in itertools.product(*(range(0, side, step) for side in difference.shape)):
            cell = difference[top : top + step, left : left + step]
            if number == 0:  # the canvas is bare: the first layer covers it
                layer.append((top + cell.shape[0] // 2, left + cell.shape[1] // 2))
            elif cell.mean() > threshold:
                down, across = divmod(int(cell.argmax()), cell.shape[1])
                layer.append((top + down, left + across))
        random.shuffle(layer)
        covered = np.zeros(difference.shape, np.uint8)
        for row, column in layer:
            if number == 0 and covered[row, column]:
                continue
            path, color = _hertzmann_path(row, column, radius, reference, painted, slope), reference[row, column]
            line = np.round(16 * path).astype(np.int32)
            for picture, value in ((painted, color.tolist()), (covered, 255)):
                cv2.polylines(picture, [line], False, value, max(1, round(2 * radius)), cv2.LINE_8, 4)
            points = (path * (1, -1) * pitch + (0, canvas.height)).clip(0, (canvas.width, canvas.height))
            red, green, blue = (color / 255).clip(0, 1).tolist()
            found.append(DrawnStroke(points, 2 * metres, (red, green, blue)))
    return found


def _hertzmann_path(
    row: int,
    column: int,
    radius: float,
    reference: NDArray[np.float64],
    painted: NDArray[np.float64],
    slope: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Returns the points (x, y) in pixels of a curved stroke (his procedure makeSplineStroke)."""
    color, (rows, columns) = reference[row, column], reference.shape[:2]
    x, y = column + 0.5, row + 0.5
    path, last_x, last_y = [(x, y)], 0.0, 0.0
    for step in range(1, _LENGTHS[1] + 1):
        place = int(y), int(x)
        seen = reference[place]
        if step > _LENGTHS[0] and np.abs(seen - painted[place]).sum() < np.abs(seen - color).sum():
            break
        across, down = slope[place].tolist()
        steep = math.hypot(across, down)
        if steep == 0:
            break
        turn = -1 if last_y * across < last_x * down else 1  # a stroke does not turn back
        last_x, last_y = -turn * down / steep, turn * across / steep
        x, y = x + radius * last_x, y + radius * last_y
        if not (0 <= x < columns and 0 <= y < rows):
            break
        path.append((x, y))
    return np.array(path if len(path) > 1 else [(x, y), (x + 1e-3, y)])
