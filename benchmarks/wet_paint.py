"""Paint on wet paint in the virtual studio: how much of the lower paint an upper mark takes up.

    python benchmarks/wet_paint.py [--brush medium] [--seeds 0 1 2] [--json figures.json]

A field of one paint is laid, and after a while one stroke of another paint across it, and beside it on the bare canvas.
The share of the lower paint is that of the mixture, by Kubelka and Munk, whose colour is nearest to the mark's.
"""

import argparse
from statistics import mean

import numpy as np
import torch

from frida_painter.brush.kinds import brush_kind
from frida_painter.canvas_size import CanvasSize
from frida_painter.lab.paintings import EXACT, connect_studio
from frida_painter.palette import Palette, difference
from frida_painter.plan import Plan
from frida_painter.session.hand import Hand
from frida_painter.strokes import Strokes
from frida_painter.virtual.paint import absorption_and_scattering, to_srgb
from frida_painter.virtual.studio import StudioSettings, open_studio
from frida_painter.virtual.tabletop import HandNoise
from measure import Table, arguments, publish

CANVAS = CanvasSize(0.12, 0.1)
PAIRS = {"white over blue": ("#1f3f8f", "#f2efe6"), "blue over white": ("#f2efe6", "#1f3f8f"),
         "red over yellow": ("#e8c32e", "#a3202c")}  # fmt: skip
WAITS = (0.0, 60.0, 180.0, 400.0)
PLACES = (0.15, 0.5, 0.85)  # of the upper stroke, from its beginning
ROWS = 400


def main() -> None:
    parser = arguments(__doc__)
    parser.add_argument("--brush", default="medium")
    parser.add_argument("--seeds", type=int, nargs="+", default=[0, 1, 2])
    options: argparse.Namespace = parser.parse_args()
    pairs, waits = dict(list(PAIRS.items())[:1]) if options.quick else PAIRS, WAITS[:1] if options.quick else WAITS
    rows, figures = [], {}
    for name, colors in pairs.items():
        for wait in waits:
            found = [crossing(options.brush, colors, wait, seed) for seed in options.seeds]
            shares = [mean(each[0][at] for each in found) for at in range(len(PLACES))]
            apart = [mean(each[1][at] for each in found) for at in range(len(PLACES))]
            figures[f"{name}, {wait:g} s"] = {"share": shares, "CIEDE2000": apart}
            percent, distance = [f"{100 * share:.0f} %" for share in shares], [f"{one:.1f}" for one in apart]
            rows.append((name, f"{wait:g}", *percent, *distance))
    names = ("beginning", "middle", "end")
    table = Table(
        f"Share of the lower paint in the upper mark, {options.brush} brush, {len(options.seeds)} seeds",
        ("paints", "s between", *names, *(f"CIEDE2000, {name}" for name in names)),
        rows,
    )
    publish([table], figures, options)


def crossing(brush: str, colors: tuple[str, str], wait: float, seed: int) -> tuple[list[float], list[float]]:
    """For each place of the upper stroke: the share of the lower paint, and the distance from the mark beside it."""
    settings = StudioSettings(placement_error=EXACT, noise=HandNoise(0.0, 0.0), drying_time=300.0)
    studio = connect_studio(open_studio(CANVAS, brush, seed=seed, settings=settings))
    kind = brush_kind(brush).for_any_order
    hand, easel = Hand(studio.easel, kind), studio.easel
    paints = torch.tensor([[int(color[at : at + 2], 16) / 255 for at in (1, 3, 5)] for color in colors])
    easel.operator.fill_wells(Palette(paints))
    lines = torch.arange(5) * 0.007 + 0.055
    lay(hand, kind, paints, 0, torch.stack((torch.full((5,), 0.03), lines), 1), 0.0, 0.06)
    easel.operator.let_dry(wait)
    beside, across = torch.tensor([[0.03, 0.02]]), torch.tensor([[0.03, 0.069]])
    lay(hand, kind, paints, 1, across, 0.0, 0.05)
    hand.clean()
    lay(hand, kind, paints, 1, beside, 0.0, 0.05)
    truth = studio.truth(ROWS)
    shares, apart = [], []
    for place in PLACES:
        seen, alone = (color_at(truth, start[0] + torch.tensor([0.05 * place, 0.0])) for start in (across, beside))
        shares.append(share_of_lower(seen, paints))
        apart.append(float(difference(seen, alone)))
    return shares, apart


def lay(hand: Hand, kind, paints: torch.Tensor, paint: int, start: torch.Tensor, angle: float, length: float) -> None:
    n, limits = len(start), kind.limits.within(CANVAS)
    same = torch.full((n,), 1.0)
    strokes = Strokes(start, angle * same, length * same, 0 * same, 0.6 * same, torch.zeros(n, 3))
    number = torch.full((n,), paint)
    plan = Plan.of(strokes, Palette(paints), number, canvas=CANVAS, brush=kind.name, limits=limits)
    for action in hand.prepare(plan, 0, n):
        hand.perform(action)


def color_at(truth: torch.Tensor, place: torch.Tensor) -> torch.Tensor:
    """The mean colour of 3 x 3 mm around a place."""
    scale = ROWS / CANVAS.height
    column, row = round(float(place[0]) * scale), round((CANVAS.height - float(place[1])) * scale)
    half = round(0.0015 * scale)
    return truth[:, row - half : row + half + 1, column - half : column + half + 1].flatten(1).mean(1)


def share_of_lower(seen: torch.Tensor, paints: torch.Tensor) -> float:
    lower, upper = absorption_and_scattering(paints.double().numpy())
    shares = np.linspace(0, 1, 201)
    mixed = shares[:, None] * lower + (1 - shares[:, None]) * upper
    ratio = mixed[:, :3] / mixed[:, 3:]
    colors = torch.from_numpy(to_srgb(1 + ratio - np.sqrt(ratio**2 + 2 * ratio))).float()
    return float(shares[int(difference(colors, seen.expand_as(colors)).argmin())])


if __name__ == "__main__":
    main()
