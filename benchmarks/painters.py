"""Painters of pixels: paintings of a robot and simulated people, against the truth of the virtual canvas.

Each person paints strokes in two pauses of the robot: a few long curves of their own hand, with a brush and a paint of
the easel. The painter of every pixel is then found as for a real painting: from journal, plan and photographs. The
truth comes from the log of the virtual studio, which is replayed: a cell belongs to the last painter who changed it.

    python benchmarks/painters.py            ten paintings, about four minutes of a processor
"""

import argparse
import tempfile
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

import frida_painter as fp
from frida_painter.brush.weights import load_models_of
from frida_painter.lab import targets
from frida_painter.plan import Plan
from frida_painter.report.painters import Painters, find_painters
from frida_painter.runs.run import PaintingRun
from frida_painter.session.controls import Controls
from frida_painter.session.events import PauseCause, Paused, StrokePainted
from frida_painter.together.turns import PenStroke
from frida_painter.virtual.canvas import Canvas
from frida_painter.virtual.studio import StudioSettings, open_studio
from frida_painter.virtual.tabletop import Table

STROKES, PAUSES, OF_PERSON = 40, (14, 28), 4
CANVAS = "20x15cm"
GOALS = ("coffee", "cat", "astronaut", "rocket", "cameraman")


def draw(random: np.random.Generator, wells: int) -> PenStroke:
    """A stroke of a simulated person: a curve of random place, way, press and paint."""
    t = np.linspace(0, 1, 60)
    x, y, angle, length = (
        random.uniform(0.2, 0.8),
        random.uniform(0.2, 0.8),
        random.uniform(0, 6.3),
        random.uniform(0.15, 0.5),
    )
    turn = angle + random.uniform(-2, 2) * t
    place = np.c_[x + length * np.cumsum(np.cos(turn)) / 60, y + length * np.cumsum(np.sin(turn)) / 60].clip(0.02, 0.98)
    press = random.uniform(0.3, 0.8) * np.sin(np.pi * (0.1 + 0.8 * t))
    zero = np.zeros_like(t)
    brush = str(random.choice(["fine", "medium", "broad"]))
    return PenStroke(brush, int(random.integers(wells)), np.c_[place, press, zero, zero, t].tolist())


def paint(seed: int, folder: Path, strokes: int = STROKES) -> Painters:
    """Paints one painting with a simulated person; returns who painted what, as it is found."""
    pauses = [round(strokes * each / STROKES) for each in PAUSES]
    goal = folder.with_suffix(".png")
    photograph = Path(targets.__file__).with_name(f"{GOALS[seed % len(GOALS)]}.jpg")
    Image.open(photograph).resize((160, 120)).save(goal)
    spec = fp.RunSpec.of(
        goal=[{"image": str(goal)}], canvas=CANVAS, fit="crop", strokes=strokes, colors=4, replans=3, brush="medium",
        layers=1, render_height=96, effort=0.1, seed=seed,
    )  # fmt: skip
    random = np.random.default_rng(seed)
    painted, paused = [0], set[int]()

    def hear(event: object) -> None:
        if isinstance(event, StrokePainted):
            painted[0] = event.done

    def pause_cause() -> PauseCause | None:
        due = next((each for each in pauses if painted[0] >= each and each not in paused), None)
        if due is None:
            return None
        paused.add(due)
        return "turn"

    def go_on(asked: Paused) -> bool:
        session = run.session
        assert session is not None and session.person.wells is not None
        for _ in range(OF_PERSON):
            session.person.paint(draw(random, len(session.person.wells.color)))
        session.look_again()
        return True

    with PaintingRun(spec, folder, controls=Controls(pause_cause=pause_cause, go_on=go_on), listeners=[hear]) as run:
        run.start()
    return find_painters(folder, load_models_of(Plan.load(folder)))


def replay(folder: Path, seed: int, rows: int, columns: int) -> NDArray[np.int32]:
    """True painter of each pixel: 0 nobody, 1 the robot, -1 the person; from the studio's log."""
    owner: list[NDArray[np.int32]] = []
    who = [1]
    touch, move = Canvas.touch, Table.move

    def note_touch(canvas: Canvas, *given: object) -> None:
        if not owner:
            owner.append(np.zeros(canvas.dry.shape, np.int32))
        before = canvas.reflectance().copy()
        touch(canvas, *given)  # type: ignore[arg-type]
        seen = canvas.reflectance()
        owner[0][np.abs(seen ** (1 / 2.2) - before ** (1 / 2.2)).max(-1) > 0.02] = who[0]

    def note_move(table: Table, *given: object) -> None:
        who[0] = 1
        move(table, *given)  # type: ignore[arg-type]
        who[0] = -1  # until the robot moves again, only a person can paint

    Canvas.touch, Table.move = note_touch, note_move  # type: ignore[method-assign]
    try:
        studio = open_studio(CANVAS, "medium", seed=seed, settings=StudioSettings(), state=folder / "studio.diary")
        studio.close()
    finally:
        Canvas.touch, Table.move = touch, move  # type: ignore[method-assign]
    cells = owner[0][::-1]
    row = ((np.arange(rows) + 0.5) / rows * cells.shape[0]).astype(int)
    column = ((np.arange(columns) + 0.5) / columns * cells.shape[1]).astype(int)
    return cells[row][:, column]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--paintings", type=int, default=10)
    parser.add_argument("--quick", action="store_true", help="one small painting")
    parser.add_argument("--keep", type=Path, help="folder for the paintings, to look at them")
    asked = parser.parse_args()
    shares = []
    with tempfile.TemporaryDirectory() as temporary:
        root = asked.keep or Path(temporary)
        root.mkdir(parents=True, exist_ok=True)
        print("| painting | robot | person | all pixels right | painted pixels right | person's pixels right |")
        print("|---|---|---|---|---|---|")
        for seed in range(1 if asked.quick else asked.paintings):
            folder = root / f"painting-{seed}"
            found = paint(seed, folder, 8 if asked.quick else STROKES)
            found.save(folder, fp.images.load(folder / "painting.png"))
            truth, says = replay(folder, seed, *found.owner.shape), np.sign(found.owner)
            right, laid = says == truth, truth != 0
            shares.append((right.mean(), right[laid].mean(), right[truth < 0].mean()))
            print(
                f"| {seed} | {(truth > 0).mean():.1%} | {(truth < 0).mean():.1%} | "
                + " | ".join(f"{share:.1%}" for share in shares[-1]) + " |", flush=True,
            )  # fmt: skip
    print("| mean | | | " + " | ".join(f"{share:.1%}" for share in np.mean(shares, 0)) + " |")


if __name__ == "__main__":
    main()
