"""Makes one plan or one painting with the checkout on the path, and writes its figures; for compare.py.

    PYTHONPATH=CHECKOUT/src:CHECKOUT/benchmarks python -P at_checkout.py plan FILE PICTURE JSON
    PYTHONPATH=CHECKOUT/src python -P at_checkout.py paint FILE PICTURE JSON

JSON are the settings. Checkouts since version 0.2.0 (commit 1499ab8) will do. Names that moved since then are looked
for at both places.
"""

import contextlib
import json
import sys
import time
from dataclasses import asdict
from importlib import import_module
from pathlib import Path
from typing import Any

import torch


def find(name: str, *modules: str) -> Any:
    """Returns what has this name in the first of these modules of the checkout that has it."""
    for module in modules:
        with contextlib.suppress(ModuleNotFoundError, AttributeError):
            return getattr(import_module(f"frida_painter.{module}"), name)
    raise ImportError(f"this checkout has no {name} in {', '.join(modules)}")


def plan(file: Path, picture: str, settings: dict[str, Any]) -> None:
    """Writes the strokes and the CPU seconds of a plan, without start-up.

    settings: strokes, colors, rows, seed and effort
    """
    import numpy as np

    from frida_painter.planning.planner import Effort, Planner  # type: ignore[attr-defined]
    from measure import ImageTerm, broad_brush, canvas_like, photograph  # type: ignore[attr-defined]

    wanted, model = photograph(picture), broad_brush()

    def make(count: int, effort: float) -> Any:
        size = canvas_like(wanted)
        chosen = getattr(Effort(), "scale" if hasattr(Effort, "scale") else "scaled")(effort)
        facts = {"rows": settings["rows"], "effort": chosen, "seed": settings["seed"]}
        wished = find("Goal", "objectives.objective", "goal")((ImageTerm(wanted),))
        try:
            from frida_painter.planning.settings import PlannerSettings
        except ImportError:  # before 0.3
            planner = Planner(wished, size, model, **facts)
        else:
            plain = {"layers": 1, "new_paints": False, "focus": "none", "sharpness": 0.0}
            planner = Planner(wished, PlannerSettings(size, model, **facts, **plain))
        bare = torch.ones(3, settings["rows"], planner.fine.columns)
        return planner.plan(bare, count, settings["colors"], lambda step: None)

    make(4, 0.02)  # loads kernels
    begun = time.process_time()
    found = make(settings["strokes"], settings["effort"]).strokes
    seconds = time.process_time() - begun
    np.savez(file, seconds=seconds, **{name: part.numpy() for name, part in found.arrays().items()})


def paint(file: Path, picture: str, settings: dict[str, Any]) -> None:
    """Writes the figures of a painting in the virtual studio.

    picture: a file
    settings: those of a RunSpec
    """
    from frida_painter import images
    from frida_painter.runs.run import PaintingRun
    from frida_painter.runs.spec import RunSpec
    from frida_painter.session.events import Dipped, Event, Scheduled

    heard: list[Event] = []
    studio = find("StudioWithout", "lab.paintings", "experiments.imperfections")()
    begun = time.process_time()
    with PaintingRun(RunSpec.of(goal=[{"image": picture}], **settings), listeners=[heard.append]) as run:
        painting = run.simulate(opener=studio.open)
        rows = run.planner.fine.rows
    truth = studio.truth(rows)
    wanted = images.fit(images.load(Path(picture)), *truth.shape[1:])
    timetable = asdict(next(event.timetable for event in heard if isinstance(event, Scheduled)))
    figures = {
        "strokes": painting.painted,
        "dips": sum(isinstance(event, Dipped) for event in heard),
        "minutes": (painting.robot_seconds - timetable["drying"]) / 60,
        "looking": timetable["looks"] / 60,
        "error": float((truth - wanted).square().mean()),
        "cpu_seconds": time.process_time() - begun,
    }
    file.write_text(json.dumps(figures))


if __name__ == "__main__":
    torch.set_num_threads(1)
    {"plan": plan, "paint": paint}[sys.argv[1]](Path(sys.argv[2]), sys.argv[3], json.loads(sys.argv[4]))
