"""A plan as SVG in real millimetres, for Inkscape, vpype, plotters and lasers: layers are paints."""

from collections.abc import Collection
from dataclasses import dataclass, field
from xml.sax.saxutils import escape, quoteattr

import torch
from torch import Tensor

from frida_painter.errors import PlanError
from frida_painter.export.bezier import control_points
from frida_painter.palette import to_hex
from frida_painter.plan import Plan

_DECIMALS = 3


@dataclass(frozen=True)
class _Layer:
    """Strokes of one well in one layer of the plan, by index; pause: whether the brush is dipped before them."""

    layer: int
    paint: int
    pause: bool
    strokes: list[int] = field(default_factory=list)


def svg(plan: Plan, width: Tensor, *, keep_order: bool = True, dips: Collection[int] = ()) -> str:
    """The plan as an SVG document: one path per stroke, one layer per paint.

    width [n]: of each stroke in metres. A new layer begins wherever the paint changes, so that
    layers painted from first to last give the plan's picture: one layer per palette colour as long
    as each colour is painted in one go, and more where the plan has several layers or colours come back. With
    `keep_order=False` there is always one layer per colour in each of the plan's layers, lightest first, for plotters
    where a change of pen costs more than the order. dips: indices of the strokes before which the brush is
    dipped: a layer begins there whose name starts with "!", where software for AxiDraws pauses; in
    painting order only. Raises PlanError where widths are not above 0 and finite.
    """
    if dips and not keep_order:
        raise PlanError("Dips are marked in painting order only; leave out either the dips or the regrouping.")
    if width.shape != (len(plan),) or not bool(((width > 0) & (width < 1)).all()):
        raise PlanError(f"An SVG of {len(plan)} strokes needs a width above 0 and below 1 m for each; measure anew.")
    across, down = (_millimetres(side) for side in (plan.canvas.width, plan.canvas.height))
    paths = _paths(plan, width)
    layers = [
        _drawn(number, plan, layer, [paths[index] for index in layer.strokes])
        for number, layer in enumerate(_layers(plan, keep_order, dips), start=1)
    ]
    ground = to_hex(torch.tensor(plan.ground))
    return "\n".join(
        (
            '<?xml version="1.0" encoding="UTF-8"?>',
            '<svg xmlns="http://www.w3.org/2000/svg" xmlns:inkscape="http://www.inkscape.org/namespaces/inkscape"',
            '     xmlns:sodipodi="http://sodipodi.sourceforge.net/DTD/sodipodi-0.dtd"',
            f'     width="{across}mm" height="{down}mm" viewBox="0 0 {across} {down}" style="background:{ground}">',
            f"  <title>{escape(f'{len(plan)} strokes in {len(plan.palette)} colours, {plan.canvas}')}</title>",
            f'  <sodipodi:namedview pagecolor="{ground}" inkscape:document-units="mm"/>',
            *layers,
            "</svg>\n",
        )
    )


def _layers(plan: Plan, keep_order: bool, dips: Collection[int]) -> list[_Layer]:
    layers: list[_Layer] = []
    places = list(zip(plan.layer.tolist(), plan.well.tolist(), strict=True))
    order = range(len(plan)) if keep_order else sorted(range(len(plan)), key=places.__getitem__)
    for index in order:
        if not layers or (layers[-1].layer, layers[-1].paint) != places[index] or index in dips:
            layers.append(_Layer(*places[index], index in dips))
        layers[-1].strokes.append(index)
    return layers


def _drawn(number: int, plan: Plan, layer: _Layer, paths: list[str]) -> str:
    of_plan = plan.layers[layer.layer]
    color = to_hex(plan.wells(of_plan).color[layer.paint])
    count = f"{len(paths)} stroke{'s' if len(paths) > 1 else ''}"
    of = f" layer {layer.layer + 1}" if len(plan.layers) > 1 else ""
    of += f" {of_plan.brush} brush" if len(plan.brushes) > 1 else ""
    # Plotter software takes the number at the start of a label as the layer's, and an exclamation mark as a pause.
    label = quoteattr(f"{'!' if layer.pause else ''}{number} paint {layer.paint + 1} {color} {count}{of}")
    return (
        f'  <g inkscape:groupmode="layer" id="layer{number}" inkscape:label={label} fill="none" stroke="{color}"'
        f' stroke-linecap="round" stroke-linejoin="round" data-paint="{layer.paint + 1}"'
        f' data-layer="{layer.layer + 1}" data-brush={quoteattr(of_plan.brush)}>\n' + "\n".join(paths) + "\n  </g>"
    )


def _paths(plan: Plan, width: Tensor) -> list[str]:
    points = plan.canvas.on_page(control_points(plan.strokes).double().cpu()) * 1000  # [n, 4, 2]
    return [
        f'    <path d="M{_pair(start)} C{_pair(first)} {_pair(second)} {_pair(end)}"'
        f' stroke-width="{_millimetres(metres)}" data-stroke="{index}" data-thickness="{thickness:.4f}"/>'
        for index, ((start, first, second, end), metres, thickness) in enumerate(
            zip(points.tolist(), width.tolist(), plan.strokes.thickness.tolist(), strict=True), start=1
        )
    ]


def _pair(point: list[float]) -> str:
    return f"{point[0]:.{_DECIMALS}f},{point[1]:.{_DECIMALS}f}"


def _millimetres(metres: float) -> str:
    return f"{metres * 1000:.{_DECIMALS}f}".rstrip("0").rstrip(".")
