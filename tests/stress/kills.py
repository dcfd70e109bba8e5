"""Kills paintings at random moments, has them resumed, and looks whether anything of them is lost.

    make stress PROGRAM=kills OPTIONS="--kills 200 --strokes 60 --seed 1"

A small painting is painted once without any interruption, by the command line, in processes of its own. Then others,
with the same seed, are killed (SIGKILL, the painting process; the easel's process sees that for itself): three of four
at a record of the journal that is drawn, the others while film and page are written. They are resumed with --yes
--repaint. Each must have all files, each stroke in its journal once, and the uninterrupted one's canvas, but for the
paint that a brush which was cleaned in between, and the one stroke in doubt, laid otherwise.
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

from frida_painter.runs.painting_folder import are_there
from frida_painter.system import images
from frida_painter.system.event_log import EventLog

_PAINT = ("--canvas", "120x90mm", "--fit", "crop", "--render-height", "64", "--effort", "0.05", "--brush", "fine",
          "--colors", "3", "--replans", "1")  # fmt: skip
_PAINTING = 0.75  # share of the kills that come between the first record of the journal and the last; then it finishes
_FINISHED = -1
_LONGEST = 600.0  # seconds that one process may take on a busy machine


@dataclass(frozen=True)
class Way:
    """How a painting goes without interruption: records in its journal, and seconds from the last to its end."""

    records: int
    finishing: float


@dataclass(frozen=True)
class Kill:
    """What came of one painting that was killed: at what share of its way, and what was wrong, if anything."""

    share: float
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
    """Paintings of so many strokes in folders below `place`, each killed at a share of its way."""
    photo = place / "photo.png"
    Image.effect_mandelbrot((300, 200), (-2.2, -1.2, 1.0, 1.2), 60).convert("RGB").save(photo)
    words = ("paint", str(photo), "--strokes", str(strokes), *_PAINT, "--yes", "--out")
    first = place / "first"
    process = _begin(place, *words, str(first))
    _wait_for(process, first, _FINISHED)
    finished = time.monotonic()
    process.communicate(timeout=_LONGEST)
    way = Way(_lines(first), time.monotonic() - finished)
    kills = []
    for number, share in enumerate(shares):
        kills.append(_killed_once(place, place / f"killed-{number}", first, words, share, way, strokes))
        one = kills[-1]
        print(f"{number + 1:4} at {one.share:4.0%}, {one.painted:3} strokes: {one.wrong or 'whole'}", flush=True)
    return kills


def _killed_once(
    place: Path, folder: Path, first: Path, words: tuple[str, ...], share: float, way: Way, strokes: int
) -> Kill:
    process = _begin(place, *words, str(folder))
    painting = share < _PAINTING
    _wait_for(process, folder, int(share / _PAINTING * way.records) if painting else _FINISHED)
    if not painting:
        time.sleep((share - _PAINTING) / (1 - _PAINTING) * way.finishing)
    process.send_signal(signal.SIGKILL)
    process.communicate()
    painted = sum(one["kind"] == "stroke_painted" for one in EventLog.read(folder / "journal"))
    said = _run(place, "resume", str(folder), "--yes", "--repaint")
    wrong = _wrong(folder, strokes)
    difference = _difference(folder, first) if not wrong else 1.0
    if not wrong and not difference <= 0.03:
        wrong = f"its canvas differs from the uninterrupted one by {difference:.3f}"
    return Kill(share, painted, difference, f"{wrong} ({said[-200:]})" if wrong else "")


def _wait_for(process: "subprocess.Popen[str]", folder: Path, records: int) -> None:
    """Until the journal has so many records, or, with _FINISHED, the last one; or the process has ended."""
    until = time.monotonic() + _LONGEST
    while process.poll() is None and time.monotonic() < until:
        if records == _FINISHED and b'"kind":"finished"' in _tail(folder).replace(b": ", b":"):
            return
        if records != _FINISHED and _lines(folder) >= max(1, records):
            return
        time.sleep(0.002)


def _lines(folder: Path) -> int:
    path = folder / "journal"
    return path.read_bytes().count(b"\n") if path.exists() else 0


def _tail(folder: Path) -> bytes:
    path = folder / "journal"
    return path.read_bytes()[-300:] if path.exists() else b""


def _wrong(folder: Path, strokes: int) -> str:
    """What is not as it must be in the folder of a finished painting; nothing where all is."""
    told = EventLog.read(folder / "journal")
    numbers = [one["done"] for one in told if one["kind"] == "stroke_painted"]
    if numbers != list(range(1, strokes + 1)):
        return f"strokes are not each painted once, in order: {numbers}"
    kinds = [one["kind"] for one in told]
    if kinds.count("finished") != 1 or kinds[-1] != "result_found":
        return f"its journal ends with {kinds[-2:]}"
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
        env={**os.environ, "XDG_STATE_HOME": str(place / "state"), "FRIDA_PAINTER_STOPS": ""},
    )


if __name__ == "__main__":
    sys.exit(main())
