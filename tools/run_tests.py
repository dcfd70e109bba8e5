"""Runs the whole test suite in parts, one after the other; a part that fails stops none.

Each part has test processes of its own: one that ran all tests would keep every library and cache that any of them
loads. What is given on the command line goes to pytest.
"""

import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[1]
# Rooms whose tests paint most, and those that talk to people. The rest is the last part.
PARTS = (
    ("lab",),
    ("benchmarks", "examples", "docs"),
    ("cli", "web"),
    ("sawyer", "hardware"),
    ("session", "easel", "procedures", "runs", "report"),
)
NO_TESTS = 5  # exit status of pytest


def main(options: list[str]) -> int:
    """Returns 0 if all tests passed, else 1."""
    named = {room for part in PARTS for room in part}
    parts = [[f"tests/{room}" for room in part] for part in PARTS]
    parts.append(["tests", *(f"--ignore=tests/{room}" for room in sorted(named))])
    failed = []
    for number, part in enumerate(parts, 1):
        print(f"Part {number} of {len(parts)} of the tests: {' '.join(part)}", flush=True)
        command = [sys.executable, "-m", "pytest", "-n", "2", "--dist", "worksteal", *options, *part]
        if subprocess.run(command, cwd=ROOT, check=False).returncode not in (0, NO_TESTS):
            failed.append(number)
    if failed:
        print(f"Failed: part {' and '.join(map(str, failed))} of the tests.", flush=True)
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
