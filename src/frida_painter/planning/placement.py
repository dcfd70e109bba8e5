"""Placement of strokes on the real canvas, learned from the photograph after each batch.

A robot that stands a few millimetres beside its expected position shifts every stroke in the same way. The shift is
found from the strokes just painted and the canvas before and after them. It is the rigid motion that makes the
simulated strokes look most like the seen ones. The fit is a least-squares fit on blurred pictures together with the
earlier estimate. Each is weighted by its information, as in a Kalman filter for a constant.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Self, TypeVar

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn import functional

from frida_painter.brush.kinds import StrokeModel
from frida_painter.calibration import BrushRecord, Calibration
from frida_painter.canvas_size import CanvasSize
from frida_painter.frames import PixelGrid
from frida_painter.planning.problem import PlanningProblem
from frida_painter.strokes.strokes import Strokes
from frida_painter.system import images


def gauss_newton(
    residual: Callable[[Tensor], Tensor], prior: Tensor, certainty: Tensor, steps: Tensor, alike: float, rounds: int
) -> tuple[Tensor, Tensor]:
    """Returns the numbers [k] that explain a picture best, and their information [k, k] (inverse covariance), float64.

    residual: function from the numbers to the unexplained part [m].
    prior [k]: earlier estimate of the numbers, with information `certainty` [k, k].
    steps [k]: step sizes of the numerical derivatives.
    alike: number of correlated residuals that together tell as much as one.
    rounds: largest number of rounds. The iteration ends earlier if a round does not reduce the residual.
    """
    numbers, left, information = prior, residual(prior), certainty
    for _ in range(rounds):
        each = [(residual(numbers - step) - residual(numbers + step)) / (2 * step.sum()) for step in torch.diag(steps)]
        slope = torch.stack(each, 1)  # [m, k], of the picture
        noise = left.square().mean().clamp(min=1e-8) * alike
        information = certainty + slope.T @ slope / noise
        pull = slope.T @ left / noise + certainty @ (prior - numbers)
        nearer = numbers + torch.linalg.solve(information, pull)
        remaining = residual(nearer)
        if not remaining.square().sum() < left.square().sum():
            break
        numbers, left = nearer, remaining
    return numbers, information


# Touch heights of the brushes, learned from the photograph after each batch.
#
# A brush may sit a millimetre higher in its holder than at its calibration, or the canvas may lie lower. Then every
# mark is thinner and shorter than planned. The difference is found from the strokes just painted and the canvas
# before and after them. It is the change of thickness that makes the simulated strokes look most like the seen
# ones. A measurement of one brush partly holds for the others, because they paint on the same canvas.

MAX_LOWER = 0.002
"""Largest correction of a brush's height in metres, lower or higher; a larger one is not believed."""
# Standard deviation of the height errors in metres: that of all brushes together, and that of each brush alone.
_TOGETHER, _EACH = 0.0005, 0.0005
_UNTOLD = 0.0003  # metres: marks in a painting differ from those in a stroke library for other reasons too
# Unknowns: thickness, length in metres, share of coverage; usual errors, and steps of derivatives. The usual error
# of coverage is small, because marks are hardly ever paler than the model. Otherwise thin marks would be taken for
# pale ones.
_USUAL, _STEPS = (0.2, 0.0005, 0.01), (0.03, 0.0005, 0.01)
_ROUNDS = 5
_CORRELATED = 0.006  # metres over which a mark differs from the model in the same way
# Least difference in sRGB between a stroke and the colour below it. On its own colour, errors of colour would be
# learned.
_CONTRAST = 0.06
_ALONG, _FEWEST = 7, 4  # points of a path that are compared; fewest strokes that must contrast
_KEPT_ASIDE = 4  # one of this many strokes is kept for validation
# Thickness below the lightest touch at which a stroke leaves no mark. At the lightest touch, its ends are pressed
# by 0.2 and its middle by almost 0.
_GONE = 0.15

_Heights = TypeVar("_Heights", Calibration, BrushRecord)


@dataclass(frozen=True)
class TouchHeights:
    """Height corrections of the brushes: how much lower than its record each brush touches the canvas.

    depths: metres between the lightest touch and the hardest press of each brush, by its name.
    lower: correction of each brush in metres; below 0 if the brush touches higher.
    information: inverse of the covariance of `lower`, in 1/m^2.
    Raises ValueError if the numbers of entries differ, or if a correction exceeds MAX_LOWER.
    """

    depths: Mapping[str, float] = field(default_factory=dict)
    lower: tuple[float, ...] = ()
    information: tuple[tuple[float, ...], ...] = ()

    def __post_init__(self) -> None:
        count = len(self.depths)
        if len(self.lower) != count or np.shape(self.information) != ((count, count) if count else (0,)):
            raise ValueError(f"touch heights {self.lower} and information {self.information} of {count} brushes")
        if not all(abs(lower) <= MAX_LOWER for lower in self.lower):
            raise ValueError(f"brushes that touch {self.lower} m lower; {MAX_LOWER} m are believed")

    @classmethod
    def unknown(cls, depths: Mapping[str, float]) -> Self:
        """Returns the estimate before any measurement: no correction, and half a millimetre of usual error."""
        count = len(depths)
        covariance = np.full((count, count), _TOGETHER**2) + np.eye(count) * _EACH**2
        return cls(dict(depths), (0.0,) * count, _rows(np.linalg.inv(covariance)))

    def after(self, brush: str, lower: float, deviation: float) -> Self:
        """Returns the estimate after one more measurement of one brush: correction and standard deviation, in metres.

        It stays as it was if a correction would exceed MAX_LOWER.
        """
        seen = np.array([float(name == brush) for name in self.depths])
        before = np.array(self.information)
        information = before + np.outer(seen, seen) / deviation**2
        best = np.linalg.solve(information, before @ np.array(self.lower) + seen * lower / deviation**2)
        if not np.abs(best).max() <= MAX_LOWER:
            return self
        return replace(self, lower=tuple(best.tolist()), information=_rows(information))

    def correction(self, brush: str) -> float:
        """Returns the metres by which a brush is sent lower than its record; 0 for an unknown brush."""
        return dict(zip(self.depths, self.lower, strict=True)).get(brush, 0.0)

    def correct(self, calibration: Calibration) -> Calibration:
        """Returns the calibration with the touch and press heights corrected."""
        others = {name: _lower(one, self.correction(name)) for name, one in calibration.others.items()}
        return _lower(replace(calibration, others=others), self.correction(calibration.brush))


@torch.no_grad()
def measure_touch(landed: Strokes, known: TouchHeights, before: PlanningProblem, seen: Tensor) -> TouchHeights:
    """Returns the touch heights after a look at painted strokes of one brush.

    landed: strokes at the places where they landed.
    before: scene in which they were painted.
    seen [3, H, W]: canvas afterwards.
    The earlier estimate stays if it explains the strokes kept for validation better.
    """
    brush = before.model.brush
    if brush not in known.depths:
        return known
    aside = torch.arange(len(landed), device=landed.angle.device) % _KEPT_ASIDE == _KEPT_ASIDE - 1
    tells = _contrast(landed, before) >= _CONTRAST
    if int(tells.sum()) < _FEWEST:
        return known
    # Visible strokes with contrast: those to learn from are black on grey, and those kept aside white.
    shade = torch.where(tells, aside.to(landed.color), 0.5)[:, None].expand(-1, 3)
    shown = replace(before, canvas=torch.full_like(before.canvas, 0.5)).render(landed.with_groups(color=shade))[0]
    learned_from, kept_aside = shown < 0.45, shown > 0.55  # [H, W]
    if not (learned_from.any() and kept_aside.any()):
        return known

    pressed = replace(before, model=_TouchingOrNot(before.model))

    def residual(numbers: Tensor, where: Tensor) -> Tensor:
        thicker, longer, opaquer = numbers.tolist()
        marks = landed.with_groups(
            thickness=(landed.thickness + thicker).clamp(max=1),
            length=(landed.length + longer).clamp(*before.model.limits.length),
        )
        # Scaled coverage: exact if marks do not overlap, and good enough to tell thin marks from pale ones.
        picture = before.canvas + (1 + opaquer) * (pressed.render(marks) - before.canvas)
        return (seen - picture)[:, where].flatten().cpu().double()

    usual, steps = torch.tensor((_USUAL, _STEPS), dtype=torch.float64)
    nothing, certainty = torch.zeros_like(usual), torch.diag(usual.square().reciprocal())
    alike = (_CORRELATED / before.size.height * before.canvas.shape[1]) ** 2
    found, information = gauss_newton(
        lambda numbers: residual(numbers, learned_from), nothing, certainty, steps, alike, _ROUNDS
    )
    left, without = (float(residual(numbers, kept_aside).square().mean()) for numbers in (found, nothing))
    if not left < without:
        return known
    deviation = float(torch.linalg.inv(information)[0, 0].sqrt())
    sent, depth = known.correction(brush), known.depths[brush]
    return known.after(brush, sent - float(found[0]) * depth, float(np.hypot(deviation * depth, _UNTOLD)))


class _TouchingOrNot:
    """Stroke model that also takes a thickness below 0: the brush touches the canvas hardly or not at all."""

    def __init__(self, model: StrokeModel) -> None:
        self._model = model
        self.brush, self.frame, self.limits = model.brush, model.frame, model.limits

    def __call__(self, thickness: Tensor, length: Tensor, bend: Tensor) -> Tensor:
        left = (1 + thickness.clamp(max=0) / _GONE).clamp(min=0)
        return self._model(thickness.clamp(0, 1), length, bend) * left[:, None, None]


def _contrast(strokes: Strokes, problem: PlanningProblem) -> Tensor:
    """Returns the mean difference between stroke colour and canvas along the path, of the largest channel, [n]."""
    grid = PixelGrid(problem.size, *problem.canvas.shape[1:])
    at = grid.to_pixels(strokes.path(torch.linspace(0, 1, _ALONG).to(strokes.angle))).round().long()  # [n, t, 2]
    column, row = at[..., 0].clamp(0, grid.columns - 1), at[..., 1].clamp(0, grid.rows - 1)
    below = problem.canvas[:, row, column].permute(1, 2, 0)  # [n, t, 3]
    return (strokes.color[:, None] - below).abs().mean(1).amax(1)


def _lower(record: _Heights, lower: float) -> _Heights:
    return replace(record, touch_height=record.touch_height - lower, press_height=record.press_height - lower)


def _rows(matrix: NDArray[np.floating]) -> tuple[tuple[float, ...], ...]:
    return tuple(map(tuple, matrix.tolist()))


# Standard deviation of the placement error of a robot set up by hand: metres, metres, radians.
_PLACEMENT_USUAL = (0.003, 0.003, math.radians(1.5))
# Step sizes of the numerical derivatives.
_STEP = (0.0005, 0.0005, math.radians(0.25))
_PLACEMENT_ROUNDS = 6
_BLUR = 0.004  # metres: edges of marks are ragged, and errors are larger than the reach of their gradients
_PLACEMENT_CORRELATED = 0.03  # metres over which the model errs in the same way


@dataclass(frozen=True)
class Placement:
    """Placement error of the robot: the offset between where strokes land and where the robot was sent.

    error: metres along the canvas's x and y, and radians counter-clockwise about the canvas centre.
    information [3, 3]: inverse of its covariance, in the same units.
    touch: height corrections of the brushes.
    """

    error: tuple[float, float, float]
    information: tuple[tuple[float, ...], ...]
    touch: TouchHeights = field(default_factory=TouchHeights)

    @classmethod
    def unknown(cls, depths: Mapping[str, float] | None = None) -> Self:
        """Returns the placement before any look: no error is assumed, with a few millimetres of deviation.

        depths: depths of the brushes whose touch heights are learned, as in TouchHeights.
        """
        information = _rows(np.diag(1 / np.square(_PLACEMENT_USUAL)))
        return cls((0.0, 0.0, 0.0), information, TouchHeights.unknown(depths or {}))

    def correct(self, calibration: Calibration, size: CanvasSize) -> Calibration:
        """Returns the calibration that sends the robot so that strokes land at their planned places."""
        x, y, turn = self.error
        cos, sin = math.cos(turn), math.sin(turn)
        middle = np.array([size.width, size.height]) / 2
        rotation = np.array([[cos, -sin], [sin, cos]])
        landing = np.eye(3)
        landing[:2, :2] = rotation
        landing[:2, 2] = middle - rotation @ middle + (x, y)
        placement = np.array(calibration.placement) @ np.linalg.inv(landing)
        return self.touch.correct(replace(calibration, placement=_rows(placement)))


def learn(meant: Strokes, known: Placement, coarse: PlanningProblem, fine: PlanningProblem, seen: Tensor) -> Placement:
    """Returns the placement and the touch heights after a look at painted strokes of one brush.

    meant: strokes as planned, sent with the correction of `known`.
    coarse, fine: scene in which they were painted, at a low and at a high resolution. The coarse one shows where
    strokes landed, the fine one the touch height.
    seen [3, H, W]: canvas afterwards.
    """
    found = locate(meant, known, coarse, images.fit(seen, *coarse.canvas.shape[1:]))
    landed = displace_strokes(_undo_displacement(meant, known.error, fine.size), found.error, fine.size)
    return replace(found, touch=measure_touch(landed, known.touch, fine, images.fit(seen, *fine.canvas.shape[1:])))


@torch.no_grad()
def locate(meant: Strokes, known: Placement, before: PlanningProblem, seen: Tensor) -> Placement:
    """Returns the placement after a look at painted strokes; arguments as for `learn`."""
    sent = _undo_displacement(meant, known.error, before.size)
    width = _odd_pixels(_BLUR, before)
    blurred = _blur(seen, width)

    def residual(error: Tensor) -> Tensor:
        landed = displace_strokes(sent, tuple(error.tolist()), before.size)
        return (blurred - _blur(before.render(landed), width)).flatten().cpu().double()

    prior, certainty, steps = (
        torch.tensor(part, dtype=torch.float64) for part in (known.error, known.information, _STEP)
    )
    alike = 3 * _odd_pixels(_PLACEMENT_CORRELATED, before) ** 2
    error, information = gauss_newton(residual, prior, certainty, steps, alike, _PLACEMENT_ROUNDS)
    x, y, turn = error.tolist()
    return Placement((x, y, turn), _rows(information.numpy()), known.touch)


def displace_strokes(strokes: Strokes, error: tuple[float, ...], size: CanvasSize) -> Strokes:
    """Returns the strokes as they land with this error: metres, metres, radians, as `Placement.error`."""
    x, y, turn = error
    middle = strokes.position.new_tensor([size.width / 2, size.height / 2])
    position = (strokes.position - middle) @ _rotation(strokes, turn) + middle
    return strokes.with_groups(position=position + position.new_tensor([x, y]), angle=strokes.angle + turn)


def _undo_displacement(strokes: Strokes, error: tuple[float, ...], size: CanvasSize) -> Strokes:
    """Returns the strokes as the robot must be sent, so that with this error they land at the given places."""
    x, y, turn = error
    middle = strokes.position.new_tensor([size.width / 2, size.height / 2])
    position = (strokes.position - strokes.position.new_tensor([x, y]) - middle) @ _rotation(strokes, -turn) + middle
    return strokes.with_groups(position=position, angle=strokes.angle - turn)


def _rotation(strokes: Strokes, turn: float) -> Tensor:
    """Returns the matrix [2, 2] that turns rows (x, y) counter-clockwise."""
    cos, sin = math.cos(turn), math.sin(turn)
    return strokes.position.new_tensor([[cos, sin], [-sin, cos]])


def _odd_pixels(metres: float, problem: PlanningProblem) -> int:
    return 2 * round(metres / problem.size.height * problem.canvas.shape[1] / 2) + 1


def _blur(picture: Tensor, width: int) -> Tensor:
    once = functional.avg_pool2d(picture[None], width, 1, width // 2, count_include_pad=False)
    return functional.avg_pool2d(once, width, 1, width // 2, count_include_pad=False)[0]
