"""What planning again wins where it is known where the robot paints: paintings with looks, and without one.

    python benchmarks/looks.py [--target rocket cat] [--seeds 0 1] [--looks 12] [--json figures.json]

Of every photograph one plan is made, and painted in the virtual studio without placement error. PSNR in dB
of the canvas as it is, to the photograph.
"""

from statistics import mean

from torch import Tensor

from frida_painter import images
from frida_painter.lab import paintings, targets
from frida_painter.lab.ladder import FULL, PHOTOGRAPHS, QUICK
from frida_painter.lab.paintings import PLACEMENT, PaintingTrial, Tell
from frida_painter.lab.targets import Target
from frida_painter.lab.trials import psnr, silent
from frida_painter.plan import Plan
from frida_painter.runs.run import PaintingRun
from frida_painter.runs.spec import RunSpec
from measure import Table, arguments, publish


def main() -> None:
    parser = arguments(__doc__)
    parser.add_argument("--target", nargs="+", default=PHOTOGRAPHS, choices=targets.PHOTOGRAPHS)
    parser.add_argument("--seeds", type=int, nargs="+", default=[0])
    parser.add_argument("--looks", type=int, default=12)
    options = parser.parse_args()
    scale = FULL
    if options.quick:
        scale, options.target, options.looks = QUICK, options.target[:1], 2
    found = [
        (target.name, seed, *_painted(target, seed, options.looks, scale))
        for target in targets.load_shipped_targets(options.target)
        for seed in options.seeds
    ]
    rows = [
        (name, str(seed), f"{plan:.2f}", f"{blind:.2f}", f"{looking:.2f}", f"{looking - blind:+.2f}")
        for name, seed, plan, blind, looking in found
    ]
    won = mean(looking - blind for *_, blind, looking in found)
    table = Table(
        f"{scale.strokes} strokes, {scale.colors} paints, placement known; PSNR to the photograph, dB",
        ("photograph", "seed", "plan as rendered", "no look", f"{options.looks} looks", "won"),
        [*rows, ("mean", "", "", "", "", f"{won:+.2f}")],
    )
    publish([table], {"won": won, "paintings": found}, options)


def _painted(target: Target, seed: int, looks: int, scale: RunSpec) -> tuple[float, float, float]:
    """How near the plan, its painting without a look, and its painting with looks are to the photograph."""
    made: list[tuple[Plan, Tensor]] = []

    def one_plan(run: PaintingRun, tell: Tell) -> tuple[Plan, Tensor]:
        if not made:
            made.append(paintings.make_first_plan(run, tell))
        return made[0]

    truths = []
    for count in (0, looks):
        spec = paintings.like(scale, target.picture, [{"image": str(target.path)}], seed, replans=count)
        trial = PaintingTrial.of({"target": target.name, "looks": count}, spec, one_plan, (PLACEMENT,))
        truths.append(paintings.paint(trial, silent).truth)
    wanted = images.fit(target.picture, *made[0][1].shape[1:])
    plan, blind, looking = (psnr(picture, wanted) for picture in (made[0][1], *truths))
    return plan, blind, looking


if __name__ == "__main__":
    main()
