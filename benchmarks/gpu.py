"""The planner on a GPU: is it right, how fast is it, how often does the CPU wait for it, how much memory does it take?

    python benchmarks/gpu.py [--device cuda:0] [--quick] [--json FILE]

Times are wall time, from an idle device to an idle device, after runs that compile and warm up. The planner is the one
that paintings are planned with; nothing of it is replaced. --device cpu shows at --quick's size that everything works.
"""

import sys
import time
import warnings
from argparse import Namespace
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, nullcontext
from dataclasses import replace
from unittest import mock

import torch
from torch import Tensor

from frida_painter.canvas_size import CanvasSize
from frida_painter.devices import half_precision, prepare_process
from frida_painter.errors import WeightsError
from frida_painter.frames import PixelGrid, pixel_to_map
from frida_painter.lab.targets import load_shipped_targets
from frida_painter.objectives.beyond_pixels import StyleTerm
from frida_painter.objectives.encoders import classifiers, clip, vgg
from frida_painter.objectives.encoders.loading import EncoderRegistry
from frida_painter.objectives.image import ImageTerm
from frida_painter.objectives.objective import Goal
from frida_painter.plan import Plan
from frida_painter.planning.effort import Effort
from frida_painter.planning.initialize import uniform
from frida_painter.planning.optimize import optimize
from frida_painter.planning.planner import Planner
from frida_painter.planning.problem import on_device
from frida_painter.planning.refine import discretize
from frida_painter.planning.settings import PlannerSettings
from frida_painter.render import composite_moments, reference
from frida_painter.words.text import TextTerm
from measure import Table, arguments, blank_problem, broad_brush, canvas_like, hardware, photograph, publish

CANVAS = CanvasSize(0.3556, 0.2794)
COLORS = 12
NO_GPU = (
    "There is no CUDA device here: PyTorch {version} sees none. Run this on a machine with an NVIDIA GPU and the CUDA "
    "build of PyTorch (pip install torch), or try it on the CPU: python benchmarks/gpu.py --device cpu --quick"
)
PARTS = ("mean", "variance", "to the maps", "to the places", "to the colours", "to the canvas")
MAX = {"float32": (1e-5, 1e-5, 1e-3, 2.5e-2, 1e-3, 1e-3), "float64": (1e-9,) * 6}  # differences of each


def name_of(device: torch.device) -> str:
    """The device as its maker calls it."""
    if device.type == "cuda":
        memory = torch.cuda.get_device_properties(device).total_memory / 2**30
        return f"{torch.cuda.get_device_name(device)}, {memory:.0f} GB, CUDA {torch.version.cuda}"
    return hardware()


def settle(device: torch.device) -> None:
    if device.type == "cuda":
        torch.cuda.synchronize(device)


def seconds(work: Callable[[], object], device: torch.device) -> float:
    """Wall time of the work, until the device has done it."""
    settle(device)
    start = time.perf_counter()
    work()
    settle(device)
    return time.perf_counter() - start


def start(strokes: int, rows: int, device: torch.device) -> Callable[[int], object]:
    """What makes so many iterations of the planner on strokes that are spread over the canvas, in a palette."""
    problem, _ = blank_problem(photograph("astronaut").to(device), CANVAS, rows, broad_brush())
    moved = replace(problem, canvas=problem.canvas.to(device), model=on_device(problem.model, device))
    spread = uniform(strokes, problem.limits, CANVAS, torch.Generator().manual_seed(0)).to(device)
    found, paints = discretize(spread, moved, min(COLORS, strokes), 0)
    return lambda iterations: optimize(found, moved, iterations=iterations, paints=paints)


def waits(work: Callable[[int], object], device: torch.device) -> float | None:
    """How often the CPU waits for the device in an iteration; None where there is nothing to wait for."""
    if device.type != "cuda":
        return None

    def counted(iterations: int) -> int:
        with warnings.catch_warnings(record=True) as heard:
            warnings.simplefilter("always")
            torch.cuda.set_sync_debug_mode("warn")
            try:
                work(iterations)
            finally:
                torch.cuda.set_sync_debug_mode("default")
        return sum("synchroniz" in str(one.message) for one in heard)

    return (counted(48) - counted(16)) / 32


def iterations(options: Namespace, device: torch.device, name: str) -> tuple[Table, list[dict[str, float]]]:
    cases = [(64, 6)] if options.quick else [(rows, n) for rows in (256, 512, 1024) for n in (100, 400, 1000, 5000)]
    count = 4 if options.quick else 80
    rows, figures = [], []
    for height, strokes in cases:
        case = [f"{height} x {PixelGrid.of_height(CANVAS, height).columns}", str(strokes)]
        try:
            if device.type == "cuda":
                torch.cuda.empty_cache()
                torch.cuda.reset_peak_memory_stats(device)
            work = start(strokes, height, device)
            work(8)
            taken = seconds(lambda work=work: work(count), device) / count
            peak = torch.cuda.max_memory_allocated(device) / 2**20 if device.type == "cuda" else float("nan")
            asked = waits(work, device)
        except torch.OutOfMemoryError:
            rows.append((*case, "out of memory", "", "", ""))
            continue
        waited = "-" if asked is None else f"{asked:.3f}"
        memory = "-" if device.type != "cuda" else f"{peak:.0f} MB"
        rows.append((*case, f"{1000 * taken:.2f} ms", f"{1 / taken:.0f}", memory, waited))
        figures.append({"rows": height, "strokes": strokes, "seconds": taken, "megabytes": peak, "waits": asked or 0})
    notes = ["A wait for eight iterations is 0.125: their losses are read together."]
    columns = ("canvas", "strokes", "an iteration", "a second", "peak memory", "waits for each")
    return Table(f"Iterations of the planner on {name}", columns, rows, notes), figures


def agreement(options: Namespace, device: torch.device, name: str) -> tuple[Table, dict[str, dict[str, float]]]:
    """The device's renderer against the reference in float64 on the CPU: moments, and gradients of a random mixture."""
    model, strokes = broad_brush(), 4 if options.quick else 40
    grid = PixelGrid.of_height(CANVAS, 48 if options.quick else 128)
    some = uniform(strokes, model.limits.within(CANVAS), CANVAS, torch.Generator().manual_seed(1))
    with torch.no_grad():
        maps = model(some.thickness, some.length, some.bend)
    places = pixel_to_map(some.position.double(), some.angle.double(), grid, model.frame)
    chance = torch.Generator().manual_seed(2)
    canvas = torch.rand(3, grid.rows, grid.columns, generator=chance)
    weights = torch.randn(2, *canvas.shape, generator=chance, dtype=torch.float64)

    def seen(lay: Callable[..., Sequence[Tensor]], dtype: torch.dtype, where: torch.device) -> list[Tensor]:
        given = (maps, places, some.color, canvas)
        leaves = [part.detach().to(where, dtype).requires_grad_() for part in given]
        moments = lay(*leaves, model.spread)
        mixture = sum((weight.to(part) * part).sum() for weight, part in zip(weights, moments, strict=True))
        gradients = torch.autograd.grad(mixture, leaves)
        return [part.detach().double().cpu() for part in (*moments, *gradients)]

    expected = seen(reference.composite_moments, torch.float64, torch.device("cpu"))
    found = {}
    for dtype in (torch.float32, torch.float64):
        mine = seen(composite_moments, dtype, device)
        off = [float((one - other).abs().max() / other.abs().max()) for one, other in zip(mine, expected, strict=True)]
        found[str(dtype).removeprefix("torch.")] = dict(zip(PARTS, off, strict=True))
    rows = []
    for precision, off in found.items():
        for (part, value), most in zip(off.items(), MAX[precision], strict=True):
            rows.append((precision, part, f"{value:.1e}", f"{most:.0e}", "yes" if value <= most else "NO"))
    notes = ["Gradients to places jump where a map has kinks: in float32 a few pixels take the other side."]
    columns = ("precision", "what", "largest difference", "allowed", "agrees")
    title = f"The renderer on {name} against the reference, relative to its largest value"
    return Table(title, columns, rows, notes), found


@contextmanager
def full_precision() -> Iterator[None]:
    """Networks compute in float32."""
    with ExitStack() as stack:
        for module in (clip, clip, classifiers, vgg):
            stack.enter_context(mock.patch.object(module, "half_precision", lambda device: nullcontext()))
        yield


def plans(options: Namespace, device: torch.device, name: str) -> tuple[Table, list[dict[str, object]]]:
    photo, style = photograph("coffee"), load_shipped_targets(["tissue"])[0].picture
    picture = Goal((ImageTerm(photo),))
    goals = {
        "photograph": (picture, 300),
        "photograph, again": (picture, 300),
        "style": (Goal((ImageTerm(photo), StyleTerm(style))), 300),
        "words": (Goal((TextTerm("a cup of coffee"),)), 300),
    }
    halves = not isinstance(half_precision(device), nullcontext)
    rows, figures, missing = [], [], []
    first: Plan | None = None
    for what, (goal, strokes) in goals.items():
        for precision in ("half", "full") if halves and goal is not picture else ("full",):
            planner: Planner | None = None
            plan: Plan | None = None

            def work(goal: Goal = goal, strokes: int = strokes) -> None:
                nonlocal planner, plan
                settings = PlannerSettings(
                    canvas_like(photo),
                    broad_brush(),
                    rows=64 if options.quick else 256,
                    effort=Effort().scale(0.03) if options.quick else Effort(),
                    layers=1,
                    new_paints=False,
                    focus="none",
                    sharpness=0.0,
                )
                planner = Planner(goal, settings, encoders=EncoderRegistry(device=device), device=device)
                plan = planner.plan(strokes=6 if options.quick else strokes, colors=6 if options.quick else COLORS)

            try:
                with full_precision() if precision == "full" else nullcontext():
                    taken = seconds(work, device)
                    assert planner is not None and plan is not None
                    loss = planner.validation_loss(planner.expected(plan))  # by networks of that precision as well
            except WeightsError:
                missing.append(what)
                break
            told = ""
            if what == "photograph":
                first = plan
            elif first is not None and goal is picture:
                told = "the same" if torch.equal(first.strokes.position, plan.strokes.position) else "another"
            networks = {"half": "bfloat16", "full": "float32"}[precision] if goal is not picture else "-"
            rows.append((what, str(len(plan)), networks, f"{taken:.1f} s", f"{loss:.5f}", told))
            figures.append({"goal": what, "networks": networks, "seconds": taken, "loss": loss})
    notes = [f"Not measured, for want of networks: {', '.join(missing)}."] if missing else []
    columns = ("goal", "strokes", "networks", "seconds", "loss", "same seed, same plan")
    return Table(f"Whole plans on {name}, with loading of networks", columns, rows, notes), figures


def main() -> int:
    parser = arguments(__doc__)
    parser.add_argument("--device", default="cuda", help="where to plan: cuda, cuda:1, or cpu to try this program")
    options = parser.parse_args()
    device = torch.device(options.device)
    if device.type == "cuda" and not torch.cuda.is_available():
        print(NO_GPU.format(version=torch.__version__), file=sys.stderr)
        return 2
    prepare_process()
    name = name_of(device)
    agrees, differences = agreement(options, device, name)
    speed, times = iterations(options, device, name)
    whole, planned = plans(options, device, name)
    figures = {"device": name, "agreement": differences, "iterations": times, "plans": planned}
    publish([agrees, speed, whole], figures, options)
    return 0 if all(row[-1] == "yes" for row in agrees.rows) else 1


if __name__ == "__main__":
    sys.exit(main())
