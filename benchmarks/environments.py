"""Steps a second of the environments, beside three of gymnasium's own.

    python benchmarks/environments.py [--seconds 3] [--json figures.json]

Each takes random actions. "one" is a single environment in one process with one thread; "two processes" are two of them
in processes of their own (AsyncVectorEnv); "vector" is the environment's own vector form in one process, with as many
threads as there are cores. A step is one action of one environment; an action of studio/plans-v1 has ten strokes.
"""

import time
from collections.abc import Iterator

import gymnasium
import torch
from gymnasium.vector import AsyncVectorEnv

import frida_painter as fp
import frida_painter.env
from frida_painter.env import RENDERER_STROKES, STUDIO_PLANS, STUDIO_STROKES
from measure import Table, arguments, publish

GYMNASIUMS_OWN = ("CartPole-v1", "Pendulum-v1", "HalfCheetah-v5")
SIZES = (16, 64, 256)
SMALL = {"canvas": "9x7cm", "brush": "fine", "rows": 28, "paints": 3, "strokes": 20}


def main() -> None:
    parser = arguments(__doc__)
    parser.add_argument("--seconds", type=float, default=3.0, help="of each measurement")
    options = parser.parse_args()
    seconds, sizes = (0.05, SIZES[:1]) if options.quick else (options.seconds, SIZES)
    settings = {**SMALL} if options.quick else {}
    rows, figures = [], {}
    for name in (STUDIO_STROKES, STUDIO_PLANS, RENDERER_STROKES, *GYMNASIUMS_OWN):
        try:
            found = dict(measure(name, settings if name in fp.env.IDS else {}, seconds, sizes))
        except gymnasium.error.DependencyNotInstalled:
            continue
        figures[name] = found
        vectors = [(size, found[size]) for size in sizes if size in found]
        best = max(vectors, key=lambda each: each[1], default=None)
        strokes = {STUDIO_STROKES: 1, STUDIO_PLANS: 10, RENDERER_STROKES: 1}.get(name)
        most = max(found.values())
        rows.append(
            (
                name, count(found["one"]), count(found["two processes"]),
                "-" if best is None else f"{count(best[1])} ({best[0]} at once)",
                "-" if strokes is None else count(strokes * most),
            )
        )  # fmt: skip
    table = Table(
        "Steps a second, random actions",
        ("environment", "one", "two processes", "vector", "strokes a second, at most"),
        rows,
    )
    publish([table], figures, options)


def measure(name: str, settings: dict, seconds: float, sizes: tuple[int, ...]) -> Iterator[tuple[object, float]]:
    """Steps a second: of one environment, of two processes, and of vectors by their size."""
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    one = gymnasium.make(name, **settings)
    yield "one", per_second(one, seconds, 1)
    one.close()
    two = AsyncVectorEnv([lambda: gymnasium.make(name, **settings)] * 2)
    yield "two processes", per_second(two, seconds, 2)
    two.close()
    torch.set_num_threads(threads)
    if gymnasium.spec(name).vector_entry_point is not None:
        for size in sizes:
            several = gymnasium.make_vec(name, size, vectorization_mode="vector_entry_point", **settings)
            yield size, per_second(several, seconds, size)
            several.close()


def per_second(env: gymnasium.Env | gymnasium.vector.VectorEnv, seconds: float, count: int) -> float:
    """Steps a second of all environments together, with their resets."""
    env.reset(seed=0)
    env.action_space.seed(0)
    env.step(env.action_space.sample())  # compiles and loads
    steps, began = 0, time.perf_counter()
    while time.perf_counter() - began < seconds:
        _, _, ended, cut, _ = env.step(env.action_space.sample())
        steps += count
        if count == 1 and isinstance(env, gymnasium.Env) and (ended or cut):
            env.reset()
    return steps / (time.perf_counter() - began)


def count(steps: float) -> str:
    return f"{steps:,.0f}" if steps >= 100 else f"{steps:.1f}"


if __name__ == "__main__":
    main()
