"""Paints in the virtual studio beside programs that keep every core busy, and counts the paintings that finish.

    make stress PROGRAM=busy OPTIONS="--paintings 20 --loops 40 --strokes 12 --seconds 3600 --at-once 1"

One painting after another, or several at once, each by the command line in processes of its own, beside so many
endless loops. A painting
must end with exit status 0 and all its strokes, however long it takes; one that takes longer than --seconds counts as
hung.
"""

import argparse
import contextlib
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from PIL import Image

_SMALL = ("--canvas", "120x90mm", "--fit", "crop", "--render-height", "64", "--effort", "0.05", "--brush", "fine",
          "--colors", "3", "--replans", "1", "--yes")  # fmt: skip


def main() -> int:
    """Prints a line per painting and the sum; exit status 1 where any did not finish."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--paintings", type=int, default=20)
    parser.add_argument("--loops", type=int, default=40)
    parser.add_argument("--strokes", type=int, default=12)
    parser.add_argument("--seconds", type=float, default=3600.0)
    parser.add_argument("--at-once", type=int, default=1)
    given = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="frida-busy-") as place, busy(given.loops):
        photo = Path(place) / "photo.png"
        Image.effect_mandelbrot((300, 200), (-2.2, -1.2, 1.0, 1.2), 60).convert("RGB").save(photo)

        def one(number: int) -> bool:
            began = time.monotonic()
            wrong = painted(photo, Path(place) / str(number), given.strokes, given.seconds)
            print(f"{number + 1:3}: {wrong or 'finished'} in {time.monotonic() - began:.0f} s", flush=True)
            return not wrong

        with ThreadPoolExecutor(given.at_once) as several:
            finished = sum(several.map(one, range(given.paintings)))
    print(f"{finished} of {given.paintings} finished beside {given.loops} busy loops on {os.cpu_count()} cores")
    return int(finished != given.paintings)


@contextlib.contextmanager
def busy(loops: int) -> Iterator[None]:
    """So many processes that do nothing but compute, while it lasts."""
    made = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(loops)]
    try:
        yield
    finally:
        for loop in made:
            loop.kill()
            loop.wait()


def painted(photo: Path, folder: Path, strokes: int, seconds: float) -> str:
    """Why a painting did not finish; nothing where it did."""
    state = {**os.environ, "XDG_STATE_HOME": str(photo.parent / "state"), "FRIDA_PAINTER_STOPS": ""}
    words = ("paint", str(photo), "--strokes", str(strokes), *_SMALL, "--out", str(folder))
    try:
        run = subprocess.run(
            [sys.executable, "-m", "frida_painter", *words], capture_output=True, text=True, timeout=seconds, env=state
        )
    except subprocess.TimeoutExpired:
        return f"not finished after {seconds:.0f} s"
    if run.returncode != 0:
        return f"exit status {run.returncode}: {run.stderr.strip()[-300:]}"
    told = json.loads((folder / "result.json").read_text())
    return "" if told["strokes_painted"] == strokes else f"only {told['strokes_painted']} of {strokes} strokes"


if __name__ == "__main__":
    sys.exit(main())
