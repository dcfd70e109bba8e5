"""Prints how many files and lines each room of the source has, its budget, and the change since the last tag.

`make size` calls it; `make size SINCE=COMMIT` compares with another state. budgets.toml has the budgets, which
tests/test_house.py holds.
"""

import argparse
import io
import subprocess
import sys
import tarfile
import tomllib
from collections import defaultdict
from collections.abc import Mapping
from pathlib import Path
from statistics import median

ROOT = Path(__file__).parents[1]
HOUSE = "src"
PAINTER = f"{HOUSE}/frida_painter/"
BESIDE = ("tests", "benchmarks", "examples", "tools")
SHORT = 60  # lines, under which a module should have a reason to be alone

Lines = Mapping[str, int]
Budgets = Mapping[str, tuple[int, int]]
"""Lines that a room may have, and those that it should come to."""


def read_budgets(root: Path) -> Budgets:
    """Returns the budgets by room as it is printed; none if there is no file."""
    file = root / "budgets.toml"
    return (
        {room: (lines, aim) for room, (lines, aim) in tomllib.loads(file.read_text()).items()} if file.exists() else {}
    )


def lines_now(root: Path) -> dict[str, int]:
    """The lines of each Python file of the working tree, by its path below `root`."""
    paths = (path for place in (HOUSE, *BESIDE) for path in (root / place).rglob("*.py"))
    return {path.relative_to(root).as_posix(): path.read_bytes().count(b"\n") for path in paths}


def lines_at(root: Path, state: str) -> dict[str, int]:
    """The lines of each Python file of a commit. Raises CalledProcessError if git does not know the state."""
    places = [place for place in (HOUSE, *BESIDE) if _git(root, "ls-tree", "-d", "--name-only", state, place)]
    archive = _git(root, "archive", "--format=tar", state, *places)
    with tarfile.open(fileobj=io.BytesIO(archive)) as opened:
        files = [member for member in opened if member.isfile() and member.name.endswith(".py")]
        return {member.name: opened.extractfile(member).read().count(b"\n") for member in files}


def last_tag(root: Path) -> str | None:
    """The nearest tag of the commits before this one; None if there is none."""
    try:
        return _git(root, "describe", "--tags", "--abbrev=0").decode().strip()
    except subprocess.CalledProcessError:
        return None


def room_of(path: str) -> str:
    """The room of a file: a room of the painter, its modules without a room, another package, or a folder beside."""
    place, _, below = path.removeprefix(PAINTER).removeprefix(f"{HOUSE}/").partition("/")
    if not path.startswith(f"{HOUSE}/"):
        return place
    return f"{place}/" if below else "(no room)"


def report(now: Lines, before: Lines, budgets: Budgets) -> list[str]:
    """A line for each room, the largest first, then the sums; `before` and `budgets` may be empty."""
    rooms: dict[str, list[int]] = defaultdict(lambda: [0, 0, 0, 0])
    for columns, lines in (((0, 1), now), ((2, 3), before)):
        for path, count in lines.items():
            total = [f"all of {HOUSE}"] if path.startswith(f"{HOUSE}/") else []
            for room in [room_of(path), *total]:
                rooms[room][columns[0]] += 1
                rooms[room][columns[1]] += count
    beside = [room for room in (f"all of {HOUSE}", *BESIDE) if room in rooms]
    inside = sorted(rooms.keys() - beside, key=lambda room: (-rooms[room][1], room))
    head = f"{'room':24}{'files':>8}{'lines':>10}" + (f"{'budget':>10}{'aim':>10}" if budgets else "")
    head += f"{'± files':>10}{'± lines':>10}" if before else ""
    told = [head]
    for room in [*inside, *beside]:
        files, lines, had_files, had_lines = rooms[room]
        change = f"{files - had_files:>+10}{lines - had_lines:>+10}" if before else ""
        allowed = "".join(f"{number:10}" for number in budgets.get(room, ())).ljust(20) if budgets else ""
        told.append(f"{room:24}{files:8}{lines:10}{allowed}{change}".rstrip())
    return told


def shape(lines: Lines) -> str:
    """A sentence about the lengths of the source's files, without `__init__.py`."""
    lengths = [
        count for path, count in lines.items() if path.startswith(f"{HOUSE}/") and not path.endswith("__init__.py")
    ]
    if not lengths:
        return "no file"
    short = sum(length < SHORT for length in lengths)
    return f"median {median(lengths):.0f} lines, {short} files under {SHORT} lines, the longest {max(lengths)}"


def _git(root: Path, *words: str) -> bytes:
    return subprocess.run(["git", *words], cwd=root, capture_output=True, check=True).stdout


def main() -> int:
    """Prints the table; exit status 2 where git does not know the state that it is compared with."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--since", metavar="COMMIT", help="a tag or commit; without it, the last tag")
    since = parser.parse_args().since or last_tag(ROOT)
    try:
        before = lines_at(ROOT, since) if since else {}
    except subprocess.CalledProcessError as error:
        print(f"git does not know {since!r}: {error.stderr.decode().strip()}", file=sys.stderr)
        return 2
    now = lines_now(ROOT)
    print("\n".join(report(now, before, read_budgets(ROOT))))
    print(f"\nNow: {shape(now)}.")
    print(f"At {since}: {shape(before)}." if since else "There is no tag yet; compare with SINCE=COMMIT.")
    return 0


if __name__ == "__main__":
    sys.exit(main())
