"""Whole commands, each in new processes: words to their first picture, and a photograph to its painting."""

import os
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import median

from clocks import Benchmark
from frida_painter.objectives import weights
from frida_painter.system import images, python_process
from frida_painter_lab.experiment import Measurement, Notify, Results, ResultTable
from frida_painter_lab.measures import psnr
from frida_painter_lab.runs import Run
from frida_painter_lab.targets import load_shipped_targets

PROMPTS = (
    "a zygote in a petri dish", "a red car", "three swans on a lake", "an old man reading a book",
    "a lighthouse in a storm", "a bowl of oranges", "a girl with a balloon in the park", "a couch in a living room",
    "two boys playing football in the rain", "hope", "first love", "a train crossing a bridge", "a village in winter",
    "a cat and two dogs", "an automobile", "a street at night without people", "Albert Einstein dancing",
    "a violinist in a red dress", "sunset over the sea", "a knight on a white horse",
)  # fmt: skip
CHILD = """
import sys
from pathlib import Path
from frida_painter.canvas_size import CanvasSize
from frida_painter.frames import PixelGrid
from frida_painter.objectives.encoders.loading import EncoderRegistry
from frida_painter_words.scene import scene_of
scene_of(sys.argv[1], PixelGrid.of_height(CanvasSize.parse("14x11in"), 480), EncoderRegistry(Path(sys.argv[2])))
"""


def run_child(*words: object, **more: str) -> tuple[float, float, float]:
    """Runs Python; returns CPU seconds, seconds and the largest resident set in MB of it and its children."""
    began = time.perf_counter()
    process = python_process.start(*words, env=python_process.environment(**more), stdout=-3)
    _, status, usage = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode:
        sys.exit(f"{' '.join(map(str, words))[:80]} ended with {process.returncode}")
    return usage.ru_utime + usage.ru_stime, time.perf_counter() - began, usage.ru_maxrss * 1024 / 1e6


@dataclass(frozen=True, kw_only=True)
class Words(Benchmark):
    """CPU seconds from words to their first picture, without a CLIP."""

    NAME = "words"
    TITLE = "The first picture of words"
    TEXT = (
        "CPU seconds from words to their first picture, each in a new process. The first prompt begins without\n"
        "embeddings in the cache and names nothing that is known, so that all nouns are read; the others find what it\n"
        "left. Needs `frida-painter models fetch words`."
    )

    def runs(self) -> Sequence[Run]:
        return [Run({"prompts": "all"})]

    def measure(self, run: Run, notify: Notify) -> Measurement:
        with tempfile.TemporaryDirectory() as cache:
            for kept in weights.cache_folder().iterdir():  # what was fetched, without the meanings
                if kept.name != "meanings":
                    (Path(cache) / kept.name).symlink_to(kept)
            prompts = PROMPTS[: 2 if self.quick else None]
            return Measurement({prompt: run_child("-c", CHILD, prompt, cache)[0] for prompt in prompts})

    def tables(self, results: Results) -> Sequence[ResultTable]:
        spent = results.found[0][1].numbers
        rows = [{"prompt": prompt, "CPU s": seconds} for prompt, seconds in spent.items()]
        notes = [f"Median {median(spent.values()):.1f} s, most {max(spent.values()):.1f} s."]
        return [ResultTable("First pictures of words", rows, notes)]


@dataclass(frozen=True, kw_only=True)
class Painting(Benchmark):
    """The whole command: `frida-painter paint` on a photograph, film and page included.

    It runs with an empty cache of compiled kernels, as on the first day, and with a full one.
    """

    NAME = "painting"
    TITLE = "A whole painting"
    TEXT = (
        "From the photograph to the finished film and page, in the virtual studio, on all cores. Memory is the\n"
        "largest resident set of any process in it."
    )

    def runs(self) -> Sequence[Run]:
        return [Run({"kernels": "all"})]

    def measure(self, run: Run, notify: Notify) -> Measurement:
        small = ["--strokes", "6", "--colors", "2", "--render-height", "64", "--effort", "0.1"] if self.quick else []
        (target,), numbers = load_shipped_targets(["cat"]), dict[str, float]()
        with tempfile.TemporaryDirectory() as place:
            for cache in ("as found",) if self.quick else ("empty", "full"):
                out, more = Path(place) / cache, {} if self.quick else {"NUMBA_CACHE_DIR": f"{place}/kernels"}
                words = ("-m", "frida_painter", "paint", target.path, "--out", out, "--film", *small)
                cpu, wall, peak = run_child(*words, **more)
                painting = images.load(out / "painting.png")
                similar = psnr(painting, images.fit(target.picture, *painting.shape[1:]))
                figures = {"wall s": wall, "CPU s": cpu, "peak MB": peak, "PSNR, dB": similar}
                numbers |= {f"{name}, {cache}": value for name, value in figures.items()}
        return Measurement(numbers)

    def tables(self, results: Results) -> Sequence[ResultTable]:
        numbers = results.found[0][1].numbers
        caches = dict.fromkeys(name.rpartition(", ")[2] for name in numbers)
        rows = [
            {
                "cache of kernels": cache,
                **{name.rpartition(", ")[0]: value for name, value in numbers.items() if name.endswith(f", {cache}")},
            }
            for cache in caches
        ]
        return [ResultTable("`frida-painter paint cat.jpg --film`", rows, ["At most 120 s (aim 60 s) and 1,500 MB."])]
