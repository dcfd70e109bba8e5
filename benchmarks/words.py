"""How recognisable plans of words are, beside the pictures that they begin with.

    python benchmarks/words.py [--prompts words.txt] [--seeds 0 1] [--folder PICTURES] [--quick] [--json FILE]

Each line of the file is a prompt, with "= CLASS" where it names a class of ImageNet. Of every plan, as rendered, the
rank of that class is told (1: nothing is more probable) by EfficientNet-Lite2, which neither optimises nor chooses
these plans, and of how many prompts no other plan of that seed shows the class more probably. Scenes, lines without a
class, are planned as `paint` plans them, and looked at by a person: --folder keeps the pictures.
"""

import time
from dataclasses import asdict, dataclass
from pathlib import Path

import torch
from torch import Tensor

from frida_painter import images, weights
from frida_painter.devices import prepare_process
from frida_painter.lab.text import JUDGE, QUICK, Prompt, Unjudged, log_probabilities, rank_of
from frida_painter.objectives.encoders.classifiers import EfficientNetLite, class_names
from frida_painter.objectives.encoders.loading import EncoderRegistry
from frida_painter.objectives.objective import Goal
from frida_painter.runs.settle import open_planner, settle_ground
from frida_painter.runs.spec import RunSpec
from frida_painter.words.text import TextTerm
from measure import Table, arguments, publish

STROKES = 100


@dataclass(frozen=True)
class Figures:
    prompt: str
    seed: int
    begun: int | None  # rank of the class
    planned: int | None
    cpu_seconds: float


def prompts_of(file: Path) -> list[Prompt]:
    """The prompts of a file, each with the numbers of the classes that it names."""
    found = []
    for line in file.read_text("utf-8").splitlines():
        words, _, named = (part.strip() for part in line.partition("="))
        classes = tuple(number for number, names in enumerate(class_names()) if named in names)
        if named and not classes:
            raise SystemExit(f"ImageNet has no class called {named!r}.")
        found.append(Prompt(words, classes))
    return found


def measure(
    prompt: Prompt, seed: int, spec: RunSpec, encoders: EncoderRegistry, judge: EfficientNetLite, folder: Path | None
) -> tuple[Figures, Tensor]:
    """Plans a prompt; also the log probabilities [1000] of what the judge sees in the plan.

    The first one that is planned loads the networks too.
    """
    start = time.process_time()
    spec = spec.with_values(goal=[{"text": prompt.words}], seed=seed)
    planner = open_planner(spec, Goal((TextTerm(prompt.words),)), encoders)
    planner, _, _ = settle_ground(spec, planner)
    shown = planner.expected(planner.plan(None, spec.strokes, spec.colors))
    seconds = time.process_time() - start
    begun = planner.goal.initial_terms[0].guide
    assert begun is not None
    if folder is not None:
        folder.mkdir(parents=True, exist_ok=True)
        name = f"{prompt.words.replace(' ', '-')}-{seed}"
        images.save(begun, folder / f"{name}-begun.png")
        images.save(shown, folder / f"{name}.png")
    beliefs = [log_probabilities(judge, one).detach() for one in (begun, shown)]
    ranks = [rank_of(belief, prompt) if prompt.classes else None for belief in beliefs]
    return Figures(prompt.words, seed, *ranks, seconds), beliefs[-1]


def own_first(prompts: list[Prompt], beliefs: list[Tensor]) -> int:
    """Of how many prompts, each with its plan, no other one's plan shows the class more probably."""
    likely = torch.stack([torch.stack([one[list(prompt.classes)].amax() for prompt in prompts]) for one in beliefs])
    return int((likely.argmax(0) == torch.arange(len(prompts))).sum())  # likely [plan, prompt]


def main() -> None:
    parser = arguments(__doc__)
    parser.add_argument("--prompts", type=Path, default=Path(__file__).with_name("words.txt"))
    parser.add_argument("--seeds", type=int, nargs="+", default=[0])
    parser.add_argument("--folder", type=Path)
    options = parser.parse_args()
    prepare_process()
    prompts, spec = prompts_of(options.prompts), RunSpec.of(strokes=STROKES)
    if options.quick:
        prompts, spec, options.seeds = prompts[:1] + prompts[-1:], QUICK, options.seeds[:1]
    judge, aside, chosen = EfficientNetLite(weights.tensors(JUDGE)), Unjudged(), EncoderRegistry()
    measured = [
        measure(prompt, seed, spec, aside if prompt.classes else chosen, judge, options.folder)
        for seed in options.seeds
        for prompt in prompts
    ]
    found = [figures for figures, _ in measured]
    named = [prompt for prompt in prompts if prompt.classes]
    first = sum(
        own_first(named, [belief for one, belief in measured if one.seed == seed and one.planned is not None])
        for seed in (options.seeds if named else ())
    )
    rows = [
        (one.prompt, str(one.seed), str(one.begun or ""), str(one.planned or ""), f"{one.cpu_seconds:.1f}")
        for one in found
    ]
    known = [(one.begun, one.planned) for one in found if one.begun is not None and one.planned is not None]
    note = (
        f"Of {len(known)} plans of a class it is within the first five for {sum(plan <= 5 for _, plan in known)} (of "
        f"the beginnings {sum(begun <= 5 for begun, _ in known)}); {sum(plan > begun for begun, plan in known)} are "
        f"less recognisable than their beginning. A prompt's own plan is first for {first}."
    )
    columns = ("prompt", "seed", "rank of the beginning", "of the plan", "CPU s")
    publish([Table(f"Words, {spec.strokes} strokes", columns, rows, (note,))], [asdict(one) for one in found], options)


if __name__ == "__main__":
    main()
