"""What the printed sheet of markers gains in the virtual studio, beside the edges of the canvas alone.

    python tests/stress/markers.py [--seed 0] [--studios 10] [--looks 500] [--moves 100]

Every studio has its own camera, light and printer: 0.3 % of error in scale, pieces laid to 0.2 mm, inks several
CIEDE2000 off. Corners and places are in millimetres, colours in CIEDE2000 over 200 colours that no card shows.
"""

import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import torch
from measure import Table, arguments, publish

from frida_painter.calibration import Calibration
from frida_painter.canvas_size import CanvasSize
from frida_painter.easel.dialogue import lead
from frida_painter.hardware.faults import Faults, LightChange, PlacementError
from frida_painter.perception.markers import find_camera_motion
from frida_painter.perception.rectify import pixels_per_metre
from frida_painter.perception.registration import TELLS
from frida_painter.session.observer import CanvasObserver
from frida_painter.strokes.palette import difference
from frida_painter.system.images import to_linear, to_srgb
from frida_painter.virtual.camera import CameraSpec
from frida_painter.virtual.printed import Printer
from frida_painter.virtual.studio import StudioSettings, VirtualStudio, open_studio
from frida_painter_calibration.procedures.canvas import canvas
from papers import proposed
from support.printed_sheet import lay_sheet

SIZE = CanvasSize(0.42, 0.297)


def studios(first: int, count: int, bleed: float = 0.02) -> Iterator[tuple[VirtualStudio, CameraSpec, int]]:
    for seed in range(first, first + count):
        chance = np.random.default_rng((seed, 7))
        spec = CameraSpec(
            filling=0.8, bleed=bleed, tilt=math.radians(chance.uniform(4, 18)),
            side=math.radians(chance.uniform(-9, 9)),
            roll=math.radians(chance.uniform(-3, 3)), lens=chance.uniform(0.002, 0.02),
        )  # fmt: skip
        studio = open_studio(SIZE, seed=seed, settings=StudioSettings(camera=spec))
        studio.easel.robot.connect()
        studio.easel.camera.connect()
        yield studio, spec, seed


def colors_off(spec: CameraSpec, record: Calibration) -> float:
    """In even light: what the camera's bands mix, and the record's map takes apart."""
    mix = torch.from_numpy(np.eye(3) * (1 - 3 * spec.bleed) + spec.bleed)
    true = torch.from_numpy(np.random.default_rng(0).uniform(0.05, 0.95, (200, 3)))
    affine = torch.tensor(record.color, dtype=torch.float64)
    seen = (to_linear(true) @ mix.T / mix.sum(1)) @ affine[:, :3].T + affine[:, 3]
    return float(difference(to_srgb(seen.clamp(0, 1)), true).mean())


def calibrate(studio: VirtualStudio) -> tuple[Calibration, list[float]]:
    """The record after one photograph, and how far each corner is off in millimetres."""
    record = lead(canvas(studio.easel), proposed).enter(studio.easel.calibration)
    pixels = pixels_per_metre(record, SIZE) / 1000
    off = np.linalg.norm(np.array(record.corners) - np.array(studio.camera.corners), axis=1) / pixels
    return record, off.tolist()


def moves(studio: VirtualStudio, record: Calibration, looks: int, count: int, seed: int) -> dict[str, list[float]]:
    """How far camera and canvas seem to have moved, in millimetres, if nothing, the one or the other moved by 0.5 mm.

    "off" is the distance of the canvas's told shift from the true one.
    """
    chance, observer = np.random.default_rng((seed, 11)), CanvasObserver(replace(studio.easel, calibration=record))
    names = ("still", "camera moved", "canvas moved")
    found: dict[str, list[float]] = {f"{what}: {by}": [] for what in names for by in ("camera", "canvas")} | {"off": []}

    def look(what: str, number: int, true: np.ndarray) -> None:
        lamps = np.random.default_rng((number, 3)).uniform(0.93, 1.05)
        studio.camera.faults = Faults(light_changes=(LightChange(0, (lamps,) * 3),))
        if observer.good is None:
            observer.learn_good(observer.photograph(-1.0).image)
        marks = find_camera_motion(studio.camera.capture(-1.0).image, record)
        shift = observer.good.register(observer.photograph(-1.0).image, None).motion
        found[f"{what}: camera"].append(1000 * marks.far if marks else math.nan)
        found[f"{what}: canvas"].append(1000 * shift.corner_shift(SIZE))
        if what == "canvas moved":
            found["off"].append(1000 * float(np.linalg.norm((shift.right, -shift.down) - true)))

    for number in range(looks):
        look("still", 1 + number, np.zeros(2))
    for number in range(count):
        angle = chance.uniform(0, 2 * math.pi)
        way = 0.0005 * np.array([math.cos(angle), math.sin(angle)])
        studio.table.knock = PlacementError(tuple(way), 0.0)
        look("canvas moved", 1000 + number, way)
        studio.table.knock = PlacementError((0.0, 0.0), 0.0)
        studio.camera.push(*(1000 * way))
        look("camera moved", 2000 + number, way)
        studio.camera.push(*(-1000 * way))
    return found


def main() -> None:
    parser = arguments(__doc__)
    parser.add_argument("--seed", type=int, default=0, help="of the first studio")
    parser.add_argument("--studios", type=int, default=10)
    parser.add_argument("--looks", type=int, default=500)
    parser.add_argument("--moves", type=int, default=100)
    options = parser.parse_args()
    torch.set_num_threads(1)
    if options.quick:
        options.studios, options.looks, options.moves = 1, 2, 2
    corners: dict[str, list[float]] = {"corners, without": [], "corners, with": []}
    colors: dict[str, list[float]] = {}
    seen: dict[str, list[float]] = {}
    for bleed, kind in ((0.02, ""), (0.1, "leaking, ")):
        for studio, spec, seed in studios(options.seed, options.studios, bleed):
            record, off = calibrate(studio)
            corners["corners, without"] += off
            colors.setdefault(f"colours, {kind}without", []).append(colors_off(spec, record))
            lay_sheet(studio, Printer.sample(seed))
            record, off = calibrate(studio)
            corners["corners, with"] += off
            colors.setdefault(f"colours, {kind}with", []).append(colors_off(spec, record))
            if not kind:
                studio.table.over = ()
                part = [-(-whole // options.studios) for whole in (options.looks, options.moves)]
                for name, values in moves(studio, record, *part, seed).items():
                    seen.setdefault(name, []).extend(values)
        print(f"bands that leak {bleed:g}: done", flush=True)
    rows = [
        (name, f"{np.mean(values):.2f}", f"{np.percentile(values, 99):.2f}", f"{max(values):.2f}", str(len(values)))
        for table in (corners, colors, seen)
        for name, values in table.items()
    ]
    told = {name: f"{np.sum(~(np.array(far) <= 1000 * TELLS))} of {len(far)}" for name, far in seen.items()}
    notes = [f"Told: {'; '.join(f'{name} {count}' for name, count in told.items() if name != 'off')}."]
    columns = ("what", "mean", "99 of 100", "worst", "values")
    publish([Table("The printed sheet", columns, rows, notes)], {**corners, **colors, **seen}, options)


if __name__ == "__main__":
    main()
