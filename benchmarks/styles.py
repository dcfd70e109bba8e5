"""Is the style of a painting seen? A small network, trained on crops of six styles' own pictures, names the style of
a photograph and of words in each of them.

    python benchmarks/styles.py [--quick] [--strokes N] [--effort X] [--out FOLDER] [--json FILE]

The judge neither optimised nor chose anything: it is trained here, from nothing, on the left part of each picture, and
tried on the right part. A second judge sees no colours, but values and marks alone.
The sheet and the plans' pictures are written to FOLDER. A picture that is there already is judged, not planned again.
"""

from dataclasses import asdict, dataclass
from itertools import pairwise
from pathlib import Path
from time import process_time

import torch
from torch import Tensor, nn
from torch.nn import functional

import frida_painter as fp
from frida_painter import images
from frida_painter.devices import prepare_process
from frida_painter.lab.targets import load_shipped_targets
from frida_painter.report.sheets import Cell, FigureRow, page
from measure import Table, arguments, publish

HERE = Path(__file__).parent / "styles"
# Written down before anything was painted.
STYLES = {
    "starry-night": ("cat", "a rabbit"), "scream": ("astronaut", "a church"),
    "woman-with-a-hat": ("coffee", "a fish"), "shipwreck": ("rocket", "an elephant"),
    "great-wave": ("cameraman", "a duck"), "udnie": ("coins", "a bicycle"),
}  # fmt: skip
NAMES = tuple(STYLES)
ROWS, SIDE, CROPS = 192, 48, 64  # rows of a picture, side of a seen crop, crops of a painting
SIZES = (40, 96)  # sides of the crops that are seen at that side, in pixels of a picture
TAUGHT = 0.7  # share of a style picture's width from which crops are taught


@dataclass(frozen=True)
class Figures:
    style: str
    painted: str
    cpu_seconds: float
    named: str
    probability: float
    named_without_color: str


def crops(picture: Tensor, count: int, chance: torch.Generator) -> Tensor:
    """Returns crops [count, 3, 48, 48] at random places, of random sizes."""
    scale = ROWS / picture.shape[1]
    small = images.fit(picture, ROWS, max(SIZES[0], round(scale * picture.shape[2])))
    found = []
    for _ in range(count):
        side = int(torch.randint(*SIZES, (), generator=chance).clamp(max=min(small.shape[1:])))
        top, left = (int(torch.randint(0, length - side + 1, (), generator=chance)) for length in small.shape[1:])
        found.append(images.fit(small[:, top : top + side, left : left + side], SIDE, SIDE))
    return torch.stack(found)


def vary(seen: Tensor, chance: torch.Generator) -> Tensor:
    """Returns crops [n, 3, h, w] as paint may change them: turned over, softened, lighter or darker, with noise."""
    if torch.rand((), generator=chance) < 0.5:
        seen = seen.flip(3)
    near = 2 * int(torch.randint(0, 3, (), generator=chance)) + 1
    seen = functional.avg_pool2d(seen, near, 1, near // 2, count_include_pad=False)
    light, noise = torch.rand(len(seen), 1, 1, 1, generator=chance), torch.randn(seen.shape, generator=chance)
    return seen * (0.85 + 0.3 * light) + 0.03 * noise


class Judge:
    """Network that names the style of a picture. With `gray` it sees no colours."""

    def __init__(self, styles: list[Tensor], steps: int, *, gray: bool) -> None:
        torch.manual_seed(0)
        self._gray = gray
        widths = (3, 16, 32, 64)
        layers = [
            part
            for before, after in pairwise(widths)
            for part in (nn.Conv2d(before, after, 3, 2, 1), nn.BatchNorm2d(after), nn.ReLU())
        ]
        self._network = nn.Sequential(
            *layers, nn.AdaptiveAvgPool2d(1), nn.Flatten(), nn.Linear(widths[-1], len(styles))
        )
        chance = torch.Generator().manual_seed(0)
        taught, kept = zip(*(self._parts(style) for style in styles), strict=True)
        pool = [crops(part, min(160, steps), chance) for part in taught]
        adam = torch.optim.Adam(self._network.parameters(), 2e-3)
        wanted = torch.arange(len(styles)).repeat_interleave(6)
        for _ in range(steps):
            picked = torch.cat([some[torch.randint(len(some), (6,), generator=chance)] for some in pool])
            adam.zero_grad()
            functional.cross_entropy(self._network(self._seen(vary(picked, chance))), wanted).backward()
            adam.step()
        self._network.eval()
        right = [self.probabilities(part).argmax() == number for number, part in enumerate(kept)]
        self.right_of_kept = sum(map(int, right))

    def _parts(self, style: Tensor) -> tuple[Tensor, Tensor]:
        middle = round(TAUGHT * style.shape[2])
        return style[:, :, :middle], style[:, :, middle:]

    def _seen(self, pictures: Tensor) -> Tensor:
        return pictures.mean(1, keepdim=True).expand_as(pictures) if self._gray else pictures

    @torch.no_grad()
    def probabilities(self, picture: Tensor) -> Tensor:
        """Returns the mean probability of each style over crops of a picture [3, H, W]."""
        seen = crops(picture, CROPS, torch.Generator().manual_seed(1))
        return self._network(self._seen(seen)).softmax(1).mean(0)


def paint(style: str, painted: str, strokes: int, effort: float) -> tuple[Tensor, float]:
    """Returns the picture of a plan, and the CPU seconds from its goal to the plan."""
    look = HERE / f"{style}.jpg"
    photo = None if " " in painted else load_shipped_targets([painted])[0].path
    goal = fp.make_goal(style=look, text=painted) if photo is None else fp.make_goal(photo, style=look)
    start = process_time()
    planner = fp.make_planner(goal, strokes=strokes, effort=effort)
    plan = planner.plan()
    seconds = process_time() - start
    return planner.expected(plan), seconds


def main() -> None:
    parser = arguments(__doc__)
    parser.add_argument("--strokes", type=int, default=100)
    parser.add_argument("--effort", type=float, default=1.0)
    parser.add_argument("--out", type=Path, default=Path("styles"))
    options = parser.parse_args()
    prepare_process()
    styles = [images.load(HERE / f"{name}.jpg") for name in NAMES]
    steps = 20 if options.quick else 500
    judge, gray = (Judge(styles, steps, gray=one) for one in (False, True))
    wanted = [(style, one) for style, both in STYLES.items() for one in both][: 1 if options.quick else None]
    options.out.mkdir(parents=True, exist_ok=True)
    figures, lines = [], {name: [Cell(picture, name)] for name, picture in zip(NAMES, styles, strict=True)}
    for style, painted in wanted:
        file, seconds = options.out / f"{style}-{painted.replace(' ', '-')}.png", float("nan")
        if not file.exists():
            strokes, effort = (6, 0.05) if options.quick else (options.strokes, options.effort)
            picture, seconds = paint(style, painted, strokes, effort)
            images.save(picture, file)
        picture = images.load(file)
        seen, told = judge.probabilities(picture), gray.probabilities(picture)
        name = NAMES[int(seen.argmax())]
        figures.append(Figures(style, painted, seconds, name, float(seen.max()), NAMES[int(told.argmax())]))
        lines[style].append(Cell(picture, f"{painted}: {name} {float(seen.max()):.2f}"))
        print(figures[-1], flush=True)
    sheet = page("", ("style", "photograph", "words"), [FigureRow("", cells) for cells in lines.values()], width=300)
    images.save(sheet, options.out / "sheet.png")
    rows = [
        (one.style, one.painted, f"{one.cpu_seconds:.0f} s", f"{one.named} ({one.probability:.2f})",
         one.named_without_color)
        for one in figures
    ]  # fmt: skip
    right, dark = (sum(getattr(one, name) == one.style for one in figures) for name in ("named", "named_without_color"))
    notes = [
        f"Right: {right} of {len(figures)}; without colours {dark}. Of the styles' own kept parts "
        f"{judge.right_of_kept} and {gray.right_of_kept} of {len(NAMES)}."
    ]
    columns = ("style", "painted", "CPU", "named", "named without colours")
    publish(
        [Table("The style that a judge sees in plans", columns, rows, notes)], [asdict(f) for f in figures], options
    )


if __name__ == "__main__":
    main()
