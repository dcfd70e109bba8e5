"""Plans as SVG in real millimetres, for Inkscape, vpype, plotters and lasers, and as CSV. SVG layers are paints."""

import csv
import io
import math
from collections.abc import Collection, Mapping, Sequence

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from frida_painter import registry
from frida_painter.brush.kinds import StrokeModel, growth_of
from frida_painter.canvas_size import CanvasSize
from frida_painter.errors import ConfigError, PlanError
from frida_painter.frames import wrap_angles
from frida_painter.report.page import template
from frida_painter.strokes.family import MAX_CODES
from frida_painter.strokes.palette import to_hex
from frida_painter.strokes.plan import Plan
from frida_painter.strokes.strokes import Strokes
from frida_painter.system.storage import count_of

# Strokes for other programs: the control points of each path, and one width that approximates its mark.

_AT_A_TIME = 64
_THINNEST = 0.0001


def control_points(strokes: Strokes) -> Tensor:
    """Returns the four control points of each stroke's cubic Bezier curve, canvas metres, [n, 4, 2]."""
    along = strokes.length[:, None] * torch.arange(4, dtype=strokes.length.dtype, device=strokes.length.device) / 3
    aside = strokes.bend[:, None] * strokes.bend.new_tensor([0.0, 1.0, 1.0, 0.0])
    cos, sin = torch.cos(strokes.angle)[:, None], torch.sin(strokes.angle)[:, None]
    x = strokes.position[:, 0:1] + cos * along - sin * aside
    y = strokes.position[:, 1:2] + sin * along + cos * aside
    return torch.stack((x, y), -1)


def bezier_paths(strokes: Strokes) -> list[Tensor]:
    """Returns the path of each stroke as cubic Bezier curves, canvas metres: n x [curves, 4, 2].

    A brush's own stroke is one curve; a stroke of a family is one curve for each span of its spline.
    """
    found = list(control_points(strokes)[:, None])
    for family, which in [] if strokes.taught is None else strokes.taught.groups():
        mine = strokes[which]
        assert mine.taught is not None
        curves = family.beziers(mine.length, mine.taught.code)  # [n, curves, 4, 2]
        cos, sin = torch.cos(mine.angle), torch.sin(mine.angle)
        turn = torch.stack((torch.stack((cos, sin), -1), torch.stack((-sin, cos), -1)), 1)  # rows (x, y) are turned
        placed = torch.einsum("ncpi,nij->ncpj", curves, turn) + mine.position[:, None, None]
        for number, path in zip(which.tolist(), placed, strict=True):
            found[number] = path
    return found


def plan_widths(plan: Plan, models: Mapping[str, StrokeModel]) -> Tensor:
    """Returns the width [n] of each stroke of a plan in metres, from `mark_widths`.

    models: stroke models of the plan by the kind of its strokes
    """
    widths = [mark_widths(part.strokes, models[part.layers[0].kind]) for part in plan.filled_layers()]
    return torch.cat(widths) if widths else torch.zeros(0)


@torch.no_grad()
def mark_widths(strokes: Strokes, model: StrokeModel) -> Tensor:
    """Returns the width [n] in metres of round-ended lines that cover the same area as the strokes' marks.

    A line of length l and width w with round ends covers l w + pi/4 w^2. A mark covers the sum of its magnitude
    map. The function solves for w, with a minimum of a tenth of a millimetre.
    """
    across, along = model.frame.pitch
    area = [
        model(part.thickness, part.length, part.shape).sum((1, 2)) * across * along
        for part in (strokes[start : start + _AT_A_TIME] for start in range(0, len(strokes), _AT_A_TIME))
    ]
    covered = torch.cat(area) if area else strokes.length
    if (growth := growth_of(model, strokes.length)) is not None:  # of a cell of each stroke's map, to the model's frame
        covered = covered * growth.square()
    path = strokes.path(torch.linspace(0, 1, 33, dtype=strokes.length.dtype, device=strokes.length.device))
    length = (path[:, 1:] - path[:, :-1]).norm(dim=-1).sum(-1)
    width = (torch.sqrt(length.square() + math.pi * covered) - length) * 2 / math.pi
    return width.clamp(min=_THINNEST)


_DECIMALS = 3


def svg(
    plan: Plan,
    width: Tensor,
    *,
    keep_order: bool = True,
    dips: Collection[int] = (),
    lettering: Sequence[NDArray[np.float64]] = (),
) -> str:
    """Returns the plan as an SVG document: one path per stroke, one SVG layer per paint.

    width: [n] of each stroke, metres
    keep_order: True for painting order; False for one SVG layer per colour in each layer of the plan, lightest
        first, for plotters on which a change of pen costs more than the order
    dips: indices of the strokes before which the brush is dipped, in painting order only; an SVG layer whose name
        starts with "!" begins there, at which software for AxiDraws pauses
    lettering: lines [k, 2] of a pen, canvas metres; they get the last SVG layer, which begins with a pause

    In painting order a new SVG layer begins at each change of paint, so that the layers give the plan's picture if
    painted from first to last. There is one SVG layer per palette colour if each colour is painted in one go, and
    more if the plan has several layers or colours return.
    Raises PlanError if a width is not above 0 and below 1 m, or if dips are given without painting order.
    """
    if dips and not keep_order:
        raise PlanError("Dips are marked in painting order only; leave out either the dips or the regrouping.")
    if width.shape != (len(plan),) or not bool(((width > 0) & (width < 1)).all()):
        raise PlanError(f"An SVG of {len(plan)} strokes needs a width above 0 and below 1 m for each; measure anew.")
    places = list(zip(plan.layer.tolist(), plan.well.tolist(), strict=True))
    groups: list[list[int]] = []  # indices of consecutive strokes of one well in one layer of the plan
    for index in range(len(plan)) if keep_order else sorted(range(len(plan)), key=places.__getitem__):
        if not groups or places[groups[-1][0]] != places[index] or index in dips:
            groups.append([])
        groups[-1].append(index)
    paths, layers = _paths(plan, width), []
    for number, group in enumerate(groups, start=1):
        layer, well = places[group[0]]
        brush, color = plan.layers[layer].brush, to_hex(plan.wells(plan.layers[layer]).color[well])
        of = f" layer {layer + 1}" if len(plan.layers) > 1 else ""
        of += f" {brush} brush" if len(plan.brushes) > 1 else ""
        # Plotter software reads the number at the start of a label as the layer's number, and "!" as a pause.
        pause = "!" if group[0] in dips else ""
        label = f"{pause}{number} paint {well + 1} {color} {count_of(len(group), 'stroke')}{of}"
        layers.append((label, color, well + 1, layer + 1, brush, [paths[index] for index in group]))
    across, down = (_millimetres(side) for side in (plan.canvas.width, plan.canvas.height))
    known = {"across": across, "down": down, "ground": to_hex(torch.tensor(plan.ground))}
    lines = (plan.canvas.on_page(torch.from_numpy(line)) * 1000 for line in lettering)
    written = ["M" + " L".join(f"{x:.{_DECIMALS}f},{y:.{_DECIMALS}f}" for x, y in line.tolist()) for line in lines]
    return template("strokes.svg").render(plan=plan, layers=layers, lettering=written, **known) + "\n"


def _paths(plan: Plan, width: Tensor) -> list[tuple[str, str, int, float, str]]:
    """Returns the path, the width in millimetres, the number, the thickness and the family of each stroke."""
    found = []
    values = (bezier_paths(plan.strokes), width.tolist(), plan.strokes.thickness.tolist(), _families(plan))
    for index, (path, metres, thickness, family) in enumerate(zip(*values, strict=True), start=1):
        curves = (plan.canvas.on_page(path.double().cpu()) * 1000).tolist()
        pairs = [[f"{x:.{_DECIMALS}f},{y:.{_DECIMALS}f}" for x, y in curve] for curve in curves]
        data = " ".join((f"M{pairs[0][0]}", *(f"C{' '.join(curve[1:])}" for curve in pairs)))
        found.append((data, _millimetres(metres), index, thickness, family))
    return found


def _families(plan: Plan) -> list[str]:
    """Returns the name of each stroke's family, "" for a brush's own stroke."""
    limits = [layer.limits for layer in plan.layers]
    names = ["" if one.family is None else one.family.name for one in limits]
    return [names[layer] for layer in plan.layer.tolist()]


def _millimetres(metres: float) -> str:
    return f"{metres * 1000:.{_DECIMALS}f}".rstrip("0").rstrip(".")


# Plans as CSV: one row per stroke in painting order, for spreadsheets and machines of any make.

COLUMNS = (
    *("stroke", "layer", "brush", "paint", "color", "start_x_mm", "start_y_mm", "end_x_mm", "end_y_mm"),
    *("angle_deg", "length_mm", "bend_mm", "thickness"),
    *(f"bezier{point}_{axis}_mm" for point in range(4) for axis in "xy"),
)


FAMILY_COLUMNS = ("family", *(f"code{number}" for number in range(1, MAX_CODES + 1)))
"""Further columns of a plan with strokes of families; such strokes have no single Bezier curve."""


def table(plan: Plan) -> str:
    """Returns the strokes as CSV with a header row.

    Lengths are millimetres from the canvas's bottom-left corner, x right, y up. Angles are degrees,
    counter-clockwise from x, in [-180, 180). Thickness is in [0, 1]. Strokes, layers and wells count from 1.
    """
    content = io.StringIO()
    rows = csv.writer(content, lineterminator="\n")
    strokes = plan.strokes
    rows.writerow((*COLUMNS, *(FAMILY_COLUMNS if plan.families else ())))
    points = (control_points(strokes).double() * 1000).flatten(1).tolist()  # n rows of x, y of four points
    paths = bezier_paths(strokes)
    families, taught = _families(plan), strokes.taught
    codes = [[""] * MAX_CODES for _ in range(len(plan))]
    if taught is not None:
        for row, number, code in zip(codes, taught.number.tolist(), taught.code.tolist(), strict=True):
            count = taught.families[number].codes if number >= 0 else 0
            row[:count] = [f"{value:.4f}" for value in code[:count]]
    colors = [to_hex(color) for color in plan.palette.color[plan.paint]]
    brushes = [layer.brush for layer in plan.layers]
    groups = zip(
        plan.layer.tolist(),
        plan.well.tolist(),
        colors,
        points,
        (wrap_angles(strokes.angle) * (180 / math.pi)).tolist(),
        (strokes.length * 1000).tolist(),
        (strokes.bend * 1000).tolist(),
        strokes.thickness.tolist(),
        strict=True,
    )
    for number, (layer, paint, color, path, angle, length, bend, thickness) in enumerate(groups, start=1):
        family, ends = families[number - 1], path
        if family:  # its path is many curves: `export --to svg` and `gcode` have them
            ends = (paths[number - 1].double() * 1000)[[0, -1], [0, -1]].flatten().tolist()
            path = []
        shape = (*ends[:2], *ends[-2:], angle, length, bend)
        numbers = (*(f"{value:.3f}" for value in shape), f"{thickness:.4f}", *(f"{value:.3f}" for value in path))
        of_family = (*([""] * (8 - len(path))), family, *codes[number - 1]) if plan.families else ()
        rows.writerow((number, layer + 1, brushes[layer], paint + 1, color, *numbers, *of_family))
    return content.getvalue()


# Titles and signatures as lines of a pen, in the public-domain fonts of A. V. Hershey.

_EDGE = 0.006  # distance of the text from the canvas's edges, metres
_TITLES, _SIGNATURES = ("futural", 0.004), ("scripts", 0.008)  # font, and metres from its lowest to its highest line
_PRINTABLE = range(32, 127)


def letter(canvas: CanvasSize, title: str = "", signature: str = "") -> list[NDArray[np.float64]]:
    """Returns the lines [k, 2] of a title in the lower left corner and a signature in the lower right one.

    In canvas metres. Raises ConfigError for a letter that the fonts lack, for text that is wider than the canvas, and
    if the package of the fonts is not installed.
    """
    found, used = list[NDArray[np.float64]](), 0.0
    for text, (font, height), is_right in ((title, _TITLES, False), (signature, _SIGNATURES, True)):
        lines = _write(text, font, height) if text.strip() else []
        if not lines:
            continue
        points = np.concatenate(lines)
        left, width = points[:, 0].min(), np.ptp(points[:, 0])
        used += width + 2 * _EDGE
        if not (used <= canvas.width and canvas.height >= 4 * _EDGE):
            raise ConfigError(
                f"Title and signature are {1000 * used:.0f} mm wide with their margins, and the canvas is "
                f"{1000 * canvas.width:.0f} x {1000 * canvas.height:.0f} mm; give shorter ones, or leave one out."
            )
        at = canvas.width - _EDGE - width if is_right else _EDGE
        found += [line + np.array((at - left, _EDGE)) for line in lines]
    return found


def _write(text: str, font: str, height: float) -> list[NDArray[np.float64]]:
    """Returns the lines of a text that stands on the axis x, metres."""
    missing = sorted({letter for letter in text if ord(letter) not in _PRINTABLE})
    if missing:
        raise ConfigError(
            f"The pen's letters have no {' '.join(missing[:5])!r}; write {text[:40]!r} with plain Latin ones."
        )
    with registry.importing("plotter", "Lettering", ConfigError):
        from HersheyFonts import HersheyFonts
    fonts = HersheyFonts()
    fonts.load_default_font(font)
    fonts.normalize_rendering(height)
    strokes = (np.array([*stroke], np.float64) for stroke in fonts.strokes_for_text(text))
    return [stroke for stroke in strokes if len(stroke) > 1]
