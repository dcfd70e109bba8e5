"""Paints one picture in the virtual studio by whatever checkout is on the path, and writes its figures; for dips.py.

    PYTHONPATH=CHECKOUT/src python -P paint_once.py FILE PICTURE SETTINGS [PAINTING]

SETTINGS are those of a RunSpec as JSON; PAINTING is where its picture goes. Only names that checkouts since November
2026 have in common are used here.
"""

import json
import sys
import time
from dataclasses import asdict
from pathlib import Path

import torch

from frida_painter import images
from frida_painter.lab.paintings import StudioWithout
from frida_painter.runs.run import PaintingRun
from frida_painter.runs.spec import RunSpec
from frida_painter.session.events import Dipped, Event, Scheduled


def main() -> None:
    file, picture, settings, *kept = sys.argv[1:]
    torch.set_num_threads(1)
    heard: list[Event] = []
    studio, begun = StudioWithout(), time.process_time()
    with PaintingRun(RunSpec.of(goal=[{"image": picture}], **json.loads(settings)), listeners=[heard.append]) as run:
        painting = run.simulate(opener=studio.open)
        rows = run.planner.fine.rows
    truth = studio.truth(rows)
    wanted = images.fit(images.load(Path(picture)), *truth.shape[1:])
    figures = {
        "strokes": painting.painted,
        "dips": sum(isinstance(event, Dipped) for event in heard),
        "washings": sum(isinstance(event, Dipped) and event.cleaned for event in heard),
        "robot_seconds": painting.robot_seconds,
        "foreseen": next(
            {name: value for name, value in asdict(event.timetable).items() if name != "after"}
            for event in heard
            if isinstance(event, Scheduled)
        ),
        "error": float((truth - wanted).square().mean()),
        "cpu_seconds": time.process_time() - begun,
    }
    Path(file).write_text(json.dumps(figures))
    if kept:
        images.save(truth, Path(kept[0]))


if __name__ == "__main__":
    main()
