"""Kills paintings at random moments, has them resumed, and looks whether anything of them is lost.

    python benchmarks/kills.py [--kills 200] [--strokes 60] [--seed 1]

A small painting is painted once without any interruption, by the command line, in processes of its own. Then others,
with the same seed, are killed (SIGKILL, the painting process; the easel's process sees that for itself) at moments
drawn evenly over the time that it took, the finishing included, and resumed with --yes --repaint until they end. Each
must have all files, all strokes in its journal once, and a canvas that is the uninterrupted one's but for the paint
that a brush which was cleaned in between, and the one stroke in doubt, laid otherwise.
"""

import argparse
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

from PIL import Image

from frida_painter import images
from frida_painter.event_log import EventLog
from frida_painter.runs.folder import are_there

_PAINT = ("--canvas", "120x90mm", "--fit", "crop", "--render-height", "64", "--effort", "0.05", "--brush", "fine",
          "--colors", "3", "--replans", "1", "--timelapse-frames", "6")  # fmt: skip
_LONGEST = 600.0  # seconds that one process may take on a busy machine


@dataclass(frozen=True)
class Kill:
    """What came of one painting that was killed: after what share of the time, and what was wrong, if anything."""

    after: float
    painted: int
    difference: float
    wrong: str


def main() -> int:
    """Prints a line per kill and the sum; exit status 1 where any painting lost something."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--kills", type=int, default=200)
    parser.add_argument("--strokes", type=int, default=60)
    parser.add_argument("--seed", type=int, default=1)
    given = parser.parse_args()
    chance = random.Random(given.seed)
    with tempfile.TemporaryDirectory(prefix="frida-kills-") as place:
        kills = killed(Path(place), given.strokes, [chance.random() for _ in range(given.kills)])
    whole = sum(not kill.wrong for kill in kills)
    most = max((kill.difference for kill in kills), default=0.0)
    print(f"{whole} of {len(kills)} resumed to a complete folder; canvases differ by {most:.4f} at the most")
    return int(whole != len(kills))


def killed(place: Path, strokes: int, shares: list[float]) -> list[Kill]:
    """Paintings of so many strokes in folders below `place`, each killed after a share of the time one takes."""
    photo = place / "photo.png"
    Image.effect_mandelbrot((300, 200), (-2.2, -1.2, 1.0, 1.2), 60).convert("RGB").save(photo)
    words = ("paint", str(photo), "--strokes", str(strokes), *_PAINT, "--yes", "--out")
    began = time.monotonic()
    first = place / "first"
    _run(place, *words, str(first))
    took = time.monotonic() - began
    kills = []
    for number, share in enumerate(shares):
        kills.append(_killed_once(place, place / f"killed-{number}", first, words, share, share * took, strokes))
        print(
            f"{number + 1:4} after {share:4.0%}, {kills[-1].painted:3} strokes: {kills[-1].wrong or 'whole'}",
            flush=True,
        )
    return kills


def _killed_once(
    place: Path, folder: Path, first: Path, words: tuple[str, ...], share: float, seconds: float, strokes: int
) -> Kill:
    process = _begin(place, *words, str(folder))
    time.sleep(seconds)
    process.send_signal(signal.SIGKILL)
    process.communicate()
    if not (folder / "journal").exists():  # nothing was painted: it is begun anew
        _run(place, *words, str(place / f"{folder.name}-anew"))
        folder = place / f"{folder.name}-anew"
    painted = sum(one["kind"] == "stroke_painted" for one in EventLog.read(folder / "journal"))
    said = _run(place, "resume", str(folder), "--yes", "--repaint")
    wrong = _wrong(folder, strokes)
    difference = _difference(folder, first) if not wrong else 1.0
    if not wrong and not difference <= 0.03:
        wrong = f"its canvas differs from the uninterrupted one by {difference:.3f}"
    return Kill(share, painted, difference, f"{wrong} ({said[-200:]})" if wrong else "")


def _wrong(folder: Path, strokes: int) -> str:
    """What is not as it must be in the folder of a finished painting; nothing where all is."""
    told = EventLog.read(folder / "journal")
    numbers = [one["done"] for one in told if one["kind"] == "stroke_painted"]
    if numbers != list(range(1, strokes + 1)):
        return f"strokes are not each painted once, in order: {numbers}"
    if told[-1]["kind"] != "finished":
        return f"its journal ends with {told[-1]['kind']!r}"
    return "" if are_there(folder, strokes) else "its page, pictures or figures are not all there"


def _difference(folder: Path, first: Path) -> float:
    """Mean difference of the two canvases over pixels and channels."""
    one, other = images.load(folder / "painting.png"), images.load(first / "painting.png")
    return float((one - other).abs().mean())


def _run(place: Path, *words: str) -> str:
    out, _ = _begin(place, *words).communicate(timeout=_LONGEST)
    return out


def _begin(place: Path, *words: str) -> "subprocess.Popen[str]":
    return subprocess.Popen(
        [sys.executable, "-m", "frida_painter", *words],
        cwd=place,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        env={**os.environ, "XDG_STATE_HOME": str(place / "state")},
    )


if __name__ == "__main__":
    sys.exit(main())
