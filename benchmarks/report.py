"""Runs all benchmarks, one after another, and writes docs/benchmarks.md from what they find.

    python benchmarks/report.py [--only iteration planning ...] [--keep]

Every benchmark leaves its figures in .benchmarks/NAME.json, with the source files that it loaded, and their digest.
The page holds figures of the present source only: those that are not run are taken from there if these files are still
the same, and are left out otherwise. --keep runs none. What needs a GPU is run if it is named. Leave the
machine alone meanwhile: wall time suffers from everything else.
"""

import argparse
import hashlib
import json
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import date
from pathlib import Path
from typing import Any

from measure import Table

ROOT = Path(__file__).parent.parent
FIGURES = ROOT / ".benchmarks"
PAGE = ROOT / "docs" / "benchmarks.md"
SOURCE = ROOT / "src" / "frida_painter"
OPENING = """# Benchmarks

`make benchmarks` runs all measurements and writes this page; nothing on it is written by hand. Each section names the
command that prints only its tables. CPU time is that of one thread unless the table says otherwise. What was measured
on earlier code, with what was tried, is in the [laboratory](lab/index.md).
"""
MISSING = "*Not measured on this code.*"


@dataclass(frozen=True)
class Section:
    """A benchmark, and what its part of the page says beside the tables.

    elsewhere: True if it needs another machine than the others.
    """

    name: str
    heading: str
    text: str
    options: tuple[str, ...] = ()
    elsewhere: bool = False

    @property
    def command(self) -> str:
        return " ".join(["python", f"benchmarks/{self.name}.py", *self.options])

    @property
    def file(self) -> Path:
        return FIGURES / f"{self.name}.json"

    @property
    def head(self) -> str:
        return f"## {self.heading}\n\n`{self.command}`\n\n{self.text}\n"

    def run(self) -> None:
        command = [sys.executable, str(ROOT / "benchmarks" / f"{self.name}.py"), *self.options]
        subprocess.run([*command, "--json", str(self.file)], check=True, cwd=ROOT)
        record = json.loads(self.file.read_text())
        record |= {"code": digest(SOURCE, record["sources"]), "date": f"{date.today():%Y-%m-%d}"}
        self.file.write_text(json.dumps(record, indent=2))

    def record(self) -> dict[str, Any] | None:
        """What was measured on the present source; None if nothing was."""
        if not self.file.exists():
            return None
        found: dict[str, Any] = json.loads(self.file.read_text())
        return found if found.get("code") == digest(SOURCE, found.get("sources", ())) else None

    def markdown(self) -> str:
        record = self.record()
        if record is None:
            return f"{self.head}\n{MISSING}\n"
        tables = [Table(**table) for table in record["tables"]]
        about = f"Measured on {record['date']}: {measured_on(record)}; source {record['code']}.\n"
        return "\n".join([self.head, about, *(f"{table.markdown()}\n" for table in tables)])


def digest(source: Path, files: Sequence[str]) -> str:
    """Twelve digits that change with the name and the content of each of these source files, and if one is gone."""
    content = hashlib.sha256()
    for name in sorted(files):
        path = source / name
        content.update(f"{name}\0".encode() + (path.read_bytes() if path.is_file() else b""))
    return content.hexdigest()[:12]


SECTIONS = (
    Section(
        "render",
        "Rendering",
        "The fast renderers are compared with the reference renderer, which works on the full canvas: forward and\n"
        "backward pass, with gradients for all inputs. Targets for `scanline`: at least 100x faster with 1/50 of the\n"
        "memory, better 200x with 1/150.\n"
        "[Renderer](explanation/renderer.md) explains it.",
    ),
    Section(
        "iteration",
        "One iteration of the planner",
        "The time of `optimize()` divided by its number of iterations is compared with one iteration as the paper\n"
        "describes it (`benchmarks/original.py`). There, each stroke is a module. For each stroke in turn, the\n"
        "network makes one map; the map is padded to the full canvas, warped, turned into RGBA and composited. L2\n"
        "loss, backward pass and Adam follow. This is faster than the original program, which took 10.1 s for one\n"
        "iteration on a similar machine. Ours looks at every second row here, in turn\n"
        "([planner](explanation/planner.md#gradient-descent)).",
        ("--no-wall",),
    ),
    Section(
        "planning",
        "How good a plan becomes",
        "The targets are photographs from scikit-image. The canvas is 279.4 mm high, the planning image 256 pixels.",
        ("--workers", "2"),
    ),
    Section(
        "compare",
        "Decibels per CPU second",
        "The default plan with less and more effort. With `--against CHECKOUT` another checkout of this repository\n"
        "plans in turns, and all plans are judged by the same renderer.",
        ("plans",),
    ),
    Section(
        "replanning",
        "Replanning",
        "The last k strokes of a plan are replanned on the rendered picture of the strokes before them. Another goal\n"
        "is planned for in three rounds, as in the studio; the photograph of the canvas comes before and is not\n"
        "counted.",
    ),
    Section(
        "looks",
        "What planning again wins",
        "Knowing where the robot paints wins something, and planning again on what the camera sees wins something.\n"
        "Here only the second is left: the robot has no placement error. The same plan is painted without a look, and\n"
        "with looks that are each followed by a replan. Where the gain comes from is told\n"
        "[in the laboratory](lab/planning.md#what-planning-again-wins).",
        ("--seeds", "11"),
    ),
    Section(
        "gpu",
        "On a GPU",
        "`make benchmarks-gpu` measures this on a machine with an NVIDIA GPU, and writes this section alone. First\n"
        "the renderer of the device is compared with the reference, picture and gradients. Then the planner is\n"
        "timed. A wait is a synchronisation, as PyTorch counts them (`set_sync_debug_mode`).\n"
        "[Renderer](lab/rendering.md#tiles) and [planner](lab/planning.md#on-a-gpu) explain\n"
        "how it works there.",
        elsewhere=True,
    ),
    Section(
        "goals",
        "Goals that networks judge",
        "Each plan has 100 strokes of the broad brush; the planning image is 256 pixels high. The time includes\n"
        "loading the networks. [Goals](lab/goals.md) explains the objectives.",
    ),
    Section(
        "sawyer",
        "The simulated Sawyer",
        "Inverse kinematics, control and physics of the arm, without paint. [The simulated\n"
        "Sawyer](explanation/virtual-studio.md#the-simulated-sawyer) "
        "explains the model. `frida-painter experiments sawyer` paints a whole picture with it.",
    ),
    Section(
        "studio",
        "The studio under load",
        "Twenty clients watch while the virtual studio plans and paints; five more connect and never read.\n"
        "[Reliability](lab/reliability.md) lists the loads that the studio is tested with.",
    ),
    Section(
        "painting",
        "A whole painting",
        "From the photograph to the finished film and page, in the virtual studio, on all cores.",
    ),
)


def measured_on(record: dict[str, Any]) -> str:
    """The machine and the versions of a record, in one line."""
    libraries = ", ".join(f"{name} {version}" for name, version in record["versions"].items())
    return f"{record['hardware']}; {libraries}"


def page() -> str:
    """The whole page, with what was measured on the present source."""
    return "\n".join([OPENING, *(section.markdown() for section in SECTIONS)])


def main() -> None:
    names = [section.name for section in SECTIONS]
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    usual = [section.name for section in SECTIONS if not section.elsewhere]
    parser.add_argument("--only", nargs="+", choices=names, default=usual, help="benchmarks that are to be run")
    parser.add_argument("--keep", action="store_true", help="run nothing; write the page from what was found before")
    parser.add_argument("--page", type=Path, default=PAGE, help="where to write the page")
    options = parser.parse_args()
    FIGURES.mkdir(exist_ok=True)
    for section in SECTIONS:
        if section.name in options.only and not options.keep:
            print(f"== {section.command}", flush=True)
            try:
                section.run()
            except subprocess.CalledProcessError as error:  # it has said why
                sys.exit(error.returncode)
    options.page.write_text(page())
    print(f"Written: {options.page}")


if __name__ == "__main__":
    main()
