"""Seconds of a processor that tests take, as tests/seconds.txt keeps them: one line for each slow test function.

A line is the seconds of all its cases together, and its name; after two spaces and a #, why one case may take long, or
why it stays slow although it is not always measured so.
"""

import re
from collections import defaultdict
from collections.abc import Iterable
from pathlib import Path

SECONDS = Path(__file__).with_name("seconds.txt")
MAX_QUICK, MAX_QUICK_CLOCK = 0.3, 1.0  # seconds of a processor and of a clock that a case of a quick test takes
MAX_TEST = 20.0  # seconds of a processor that a case takes without a reason
_LINE = re.compile(r"(?P<seconds>\d+\.\d) (?P<name>\S+)(?:  # (?P<why>.+))?")
_TEST = re.compile(r"^ *def (test_\w+)\(", re.M)


def function_of(item: str) -> str:
    """Returns the name of a test function, of that of one of its cases ("tests/test_it.py::TestIt::test_it[case]")."""
    file, *_, function = item.split("[")[0].split("::")
    return f"{file}::{function}"


def read_seconds(path: Path = SECONDS) -> dict[str, tuple[float, str]]:
    """Returns seconds and reason ("" if none) of each slow test function. Raises ValueError for a foreign line."""
    known = {}
    for line in path.read_text().splitlines():
        if (found := _LINE.fullmatch(line.strip())) is None:
            raise ValueError(f"{path.name} has a line that is no seconds and name of a test: {line!r}")
        known[found["name"]] = float(found["seconds"]), found["why"] or ""
    return known


def write_seconds(known: dict[str, tuple[float, str]], path: Path = SECONDS) -> None:
    """Writes what `read_seconds` reads, by name."""
    lines = (f"{took:6.1f} {name}{why and f'  # {why}'}\n" for name, (took, why) in sorted(known.items()))
    path.write_text("".join(lines))


def list_tests(file: Path) -> list[str]:
    """Returns the names of a file's test functions, without running it."""
    return _TEST.findall(file.read_text()) if file.is_file() else []


def renew_seconds(times: Iterable[str], root: Path, path: Path = SECONDS, *, quick: bool = False) -> None:
    """Writes what was measured. What is gone leaves, and what has become quick, unless it has a reason.

    times: one case a line: seconds of a processor, seconds of a clock, name
    quick: few examples of each property were tried, so what was measured says nothing of the whole
    """
    known, cases = read_seconds(path), defaultdict[str, list[tuple[float, float]]](list)
    for line in times:
        processor, clock, name = line.split(" ", 2)
        cases[function_of(name.strip())].append((float(processor), float(clock)))
    for name, took in cases.items():
        share = max(max(one / MAX_QUICK, clock / MAX_QUICK_CLOCK) for one, clock in took)
        if name in known and share < 0.5 and not quick and not known[name][1]:
            del known[name]
        elif name in known or (quick and share > 1):
            known[name] = sum(one for one, _ in took), known.get(name, (0.0, ""))[1]
    write_seconds({name: entry for name, entry in known.items() if _is_test(name, root)}, path)


def _is_test(name: str, root: Path) -> bool:
    file, _, function = name.partition("::")
    return function in list_tests(root / file)
