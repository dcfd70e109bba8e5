"""Processor seconds from words to their first picture, without a CLIP, each in a new process.

    python benchmarks/first_pictures.py [--json figures.json] [FILE]

FILE: prompts, one a line; by default twenty. Needs `frida-painter models fetch words`. The first prompt begins without
embeddings in the cache, and names nothing that is known, so that all nouns are read; the others find what it left.
"""

import os
import subprocess
import sys
import tempfile
from pathlib import Path
from statistics import median

from frida_painter import weights
from measure import Table, arguments, publish

PROMPTS = """\
a zygote in a petri dish
a red car
three swans on a lake
an old man reading a book
a lighthouse in a storm
a bowl of oranges
a girl with a balloon in the park
a couch in a living room
two boys playing football in the rain
hope
first love
a train crossing a bridge
a village in winter
a cat and two dogs
an automobile
a street at night without people
Albert Einstein dancing
a violinist in a red dress
sunset over the sea
a knight on a white horse"""
CHILD = """
import sys
from pathlib import Path
from frida_painter.canvas_size import CanvasSize
from frida_painter.frames import PixelGrid
from frida_painter.objectives.encoders.loading import EncoderRegistry
from frida_painter.words.scene import scene_of
scene_of(sys.argv[1], PixelGrid.of_height(CanvasSize.parse("14x11in"), 480), EncoderRegistry(Path(sys.argv[2])))
"""


def main() -> None:
    parser = arguments(__doc__)
    parser.add_argument("file", nargs="?", type=Path)
    options = parser.parse_args()
    prompts = [one.strip() for one in (options.file.read_text("utf-8") if options.file else PROMPTS).split("\n")]
    spent: list[float] = []
    with tempfile.TemporaryDirectory() as folder:
        cache = Path(folder)
        for kept in weights.cache_folder().iterdir():  # what was fetched, without the meanings
            if kept.name != "meanings":
                (cache / kept.name).symlink_to(kept)
        for prompt in prompts[: 2 if options.quick else None]:
            before = os.times()
            subprocess.run([sys.executable, "-c", CHILD, prompt, str(cache)], check=True)
            after = os.times()
            spent.append(after.children_user + after.children_system - before.children_user - before.children_system)
    rows = [(prompt, f"{seconds:.1f}") for prompt, seconds in zip(prompts, spent, strict=False)]
    notes = [f"Median {median(spent):.1f} s, most {max(spent):.1f} s; the first began without any meanings."]
    publish([Table("First pictures of words", ["prompt", "CPU s"], rows, notes)], spent, options)


if __name__ == "__main__":
    main()
