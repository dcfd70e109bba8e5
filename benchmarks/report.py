"""Runs benchmarks, one after another, and writes what they find into docs/benchmarks.md.

    python benchmarks/report.py [iteration plan ...] [--quick] [--page FILE]

Each is an experiment like those of the paper (frida_painter_lab.experiment). Without names all are run that need no
other machine. A section that is not run stays as it is, with its date. Leave the machine alone meanwhile.
"""

import argparse
import os
import re
import sys
from collections.abc import Sequence
from datetime import date
from importlib import import_module
from pathlib import Path

from clocks import Benchmark
from frida_painter.system.devices import prepare_process
from frida_painter.system.provenance import describe_here
from frida_painter_lab.experiment import Outcome, Progress

PAGE = Path(__file__).parent.parent / "docs" / "benchmarks.md"
OPENING = """# Benchmarks

`make benchmarks` runs all measurements and writes this page; nothing on it is written by hand. `python
benchmarks/report.py NAME` renews a section. CPU time is that of one thread unless the table says otherwise. What was
measured before, with what was tried, is in the [laboratory](lab/index.md).
"""
MISSING = "*Not measured yet.*\n"
PLACES = {
    "render": "planner:Render",
    "iteration": "planner:Iteration",
    "plan": "planner:Plans",
    "words": "whole:Words",
    "painting": "whole:Painting",
    "studio": "studio:StudioLoad",
    "gpu": "gpu:Gpu",
}


def find_benchmark(name: str) -> type[Benchmark]:
    """Returns the class of a benchmark."""
    module, _, kind = PLACES[name].partition(":")
    found: type[Benchmark] = getattr(import_module(module), kind)
    return found


def head_of(kind: type[Benchmark]) -> str:
    """Returns what a section begins with."""
    return f"## {kind.TITLE}\n\n`python benchmarks/report.py {kind.NAME}`\n\n{kind.TEXT}\n"


def processor() -> str:
    """Returns the name of the processor; "" if the system does not tell it."""
    cpus = Path("/proc/cpuinfo")
    lines = cpus.read_text("utf-8", "replace").splitlines() if cpus.exists() else []
    return next((line.partition(":")[2].strip() for line in lines if line.startswith("model name")), "")


def section_of(kind: type[Benchmark], outcome: Outcome) -> str:
    """Returns the section of a benchmark that was run."""
    facts = describe_here()
    versions = ", ".join(f"{name} {facts[name]}" for name in ("python", "torch", "numpy", "numba"))
    machine = f"{processor() or facts['machine']}, {os.cpu_count()} cores"
    about = f"Measured on {date.today():%Y-%m-%d}: {machine}; {versions}; code {facts['code']}.\n"
    return "\n".join([head_of(kind), about, *outcome.notes, *(table.markdown() for table in outcome.tables)])


def known_sections(page: str) -> dict[str, str]:
    """Returns the sections of a page by their headings."""
    parts = re.split(r"^(?=## )", page, flags=re.MULTILINE)[1:]
    return {part.partition("\n")[0].removeprefix("## "): part for part in parts}


def write_page(path: Path, found: dict[str, str]) -> None:
    """Writes the page: sections that were found, others as they are on it, by their headings."""
    known = known_sections(path.read_text(encoding="utf-8")) if path.exists() else {}
    kinds = [find_benchmark(name) for name in PLACES]
    empty = {kind.TITLE: f"{head_of(kind)}\n{MISSING}" for kind in kinds}
    sections = [{**empty, **known, **found}[kind.TITLE].strip() + "\n" for kind in kinds]
    path.write_text("\n".join([OPENING, *sections]), encoding="utf-8")


def main(words: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"which: {', '.join(PLACES)}")
    parser.add_argument("--quick", action="store_true", help="a tiny run that only shows that everything works")
    parser.add_argument("--page", type=Path, default=PAGE, help="where to write the page")
    given = parser.parse_args(words)
    if unknown := set(given.names) - set(PLACES):
        parser.error(f"there is no benchmark {', '.join(unknown)}; there are {', '.join(PLACES)}")
    prepare_process()
    for name in given.names or [name for name in PLACES if not find_benchmark(name).ELSEWHERE]:
        kind = find_benchmark(name)
        outcome = kind(quick=given.quick).run(notify=tell)
        print("\n".join([*outcome.notes, *(table.markdown() for table in outcome.tables)]), flush=True)
        write_page(given.page, {kind.TITLE: section_of(kind, outcome)})


def tell(progress: Progress) -> None:
    print(f"{100 * progress.share:3.0f} %  {progress.doing}", file=sys.stderr, flush=True)


if __name__ == "__main__":
    main()
