"""The whole command: `frida-painter paint` on a photograph, film and page included.

    python benchmarks/painting.py [--json figures.json] [--strokes 300]

The command runs twice, each time in a process of its own: with an empty cache of compiled kernels,
as on the first day, and with a full one. Memory is the largest resident set of any process in it.
"""

import os
import subprocess
import sys
import tempfile
import time
from dataclasses import asdict, dataclass
from pathlib import Path

from frida_painter import images
from measure import Table, arguments, photograph, psnr, publish

EXPECTED = ("painting.png", "plan.json", "palette.png", "film.mp4", "index.html", "strokes.svg", "result.json")


@dataclass(frozen=True)
class Figures:
    """One run of the command; PSNR is that of the photographed painting against the photograph wanted."""

    cache: str
    wall_seconds: float
    cpu_seconds: float
    peak_megabytes: float
    psnr: float


def paint(photo: Path, folder: Path, settings: list[str], name: str, environment: dict[str, str]) -> Figures:
    command = [sys.executable, "-m", "frida_painter", "paint", str(photo), "--out", str(folder), *settings]
    log = photo.with_suffix(".log")
    with log.open("w") as output:
        begun = time.perf_counter()
        process = subprocess.Popen(command, env=os.environ | environment, stdout=output, stderr=output)
        _, status, usage = os.wait4(process.pid, 0)
        seconds = time.perf_counter() - begun
    process.returncode = os.waitstatus_to_exitcode(status)
    missing = [file for file in EXPECTED if not (folder / file).exists()]
    if process.returncode or missing:
        raise SystemExit(f"{' '.join(command)} ended with {process.returncode}, missing {missing}:\n{log.read_text()}")
    painting = images.load(folder / "painting.png")
    wanted = images.fit(images.load(photo), *painting.shape[1:])
    return Figures(
        name,
        seconds,
        usage.ru_utime + usage.ru_stime,
        usage.ru_maxrss * 1024 / 1e6,
        psnr(float((painting - wanted).square().mean())),
    )


def main() -> None:
    parser = arguments(__doc__)
    parser.add_argument("--picture", default="cat")
    parser.add_argument("--strokes", type=int, default=300)
    parser.add_argument("--colors", type=int, default=12)
    parser.add_argument("--replans", type=int, default=4)
    options = parser.parse_args()
    more: list[str] = []
    runs = ["empty", "full"]
    if options.quick:
        options.strokes, options.colors, options.replans, runs = 6, 2, 1, ["as found"]
        more = ["--render-height", "64", "--effort", "0.1"]
    settings = [
        *("--strokes", str(options.strokes), "--colors", str(options.colors)),
        *("--replans", str(options.replans), "--film", *more),
    ]
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        photo = folder / f"{options.picture}.jpg"
        images.save(photograph(options.picture), photo)
        environment = {} if options.quick else {"NUMBA_CACHE_DIR": str(folder / "kernels")}
        figures = [paint(photo, folder / name, settings, name, environment) for name in runs]
    table = Table(
        f"`frida-painter paint {photo.name} {' '.join(settings)}`",
        ("cache of kernels", "wall", "at most", "aim", "CPU", "peak memory", "at most", "PSNR of the painting"),
        [
            (
                one.cache, f"{one.wall_seconds:.0f} s", "120 s", "60 s", f"{one.cpu_seconds:.0f} s",
                f"{one.peak_megabytes / 1000:.2f} GB", "1.5 GB", f"{one.psnr:.1f} dB",
            )
            for one in figures
        ],
    )  # fmt: skip
    publish([table], [asdict(one) for one in figures], options)


if __name__ == "__main__":
    main()
