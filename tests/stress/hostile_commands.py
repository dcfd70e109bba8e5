"""Gives the command line senseless and hostile words, as somebody would who means harm, and looks what comes of it.

    make stress PROGRAM=hostile_commands OPTIONS="--lines 1000 --seed 1 --seconds 5"

The lines are made from the commands' own description: every command, every option and argument, filled with what is
good, and at least once with what is not: devices, pipes, sockets, links to them, files that are empty, damaged, too
large or never end, names that no file can have, numbers that are none, too long or too large. Each line runs in a
process of its own, a copy of one that has loaded everything. None may show a traceback, crash, do nothing for more
than --seconds, fill more than 1 GB, or leave a process behind. A line that makes sense in spite of all goes to work;
it is ended after a while by SIGTERM and must end in order.
"""

import argparse
import contextlib
import json
import os
import random
import shlex
import signal
import socket
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import torch
from PIL import Image

from frida_painter import __main__ as program
from frida_painter_cli.commands import all_commands

_LEFT_OUT = {("studio",), ("models", "fetch")}  # one serves until it is ended, the other waits for a network
_AT_WORK = 4.0  # seconds of computing after which a line has gone to work
_ENDING = 60.0  # seconds within which whoever was ended has to end, on a busy machine
_MAX_BYTES = 2**30
NUMBERS = ("", "0", "-1", "9" * 400, "nan", "inf", "-inf", "1e999", "0x10", "²", "1_0", " 7 ", "1,5", "--", "-0")
WORDS = ("", " ", "\x1b[31mred", "ä" * 3000, "\u202e", "../..", "every:nan", "when-off-by:-1", "virtual:5",
         "xarm:", "-",
         "gcode:pipe", "gcode:/dev/null", "gcode:/dev/zero,baud=0", "rosbridge:localhost:1", "rosbridge:[::1", "xarm:☃",
         "opencv:99999999999999999999", "folder:/dev", "folder:pipe", "14x11", "nanxnanmm", "1e300x1mm", "human",
         "\udcff",
         "4mm,2deg,7", "nan", "999999999mm", "sawyer-sim", "{}", "[red]", "%s%n", "axidraw:/dev/full")  # fmt: skip


@dataclass(frozen=True)
class Parameter:
    """One option or argument of a command: its name on the line ("" for an argument), and what it takes."""

    name: str
    takes: type | None
    needed: bool


@dataclass(frozen=True)
class Command:
    """A command with all that it can be given."""

    path: tuple[str, ...]
    parameters: tuple[Parameter, ...]


@dataclass
class Outcome:
    """How a line ended: its exit status (None: it had to be killed), and what was wrong, if anything."""

    line: list[str]
    status: int | None = None
    said: str = ""
    wrong: str = ""
    worked: bool = False
    seconds: float = 0.0
    most: int = field(default=0)


def main() -> int:
    """Prints what is wrong with which line, and the sums; exit status 1 where anything is."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--lines", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--seconds", type=float, default=5.0)
    given = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="frida-hostile-") as place:
        outcomes = list(tried(Path(place), given.lines, given.seed, given.seconds))
    wrong = [one for one in outcomes if one.wrong]
    statuses = Counter(one.status for one in outcomes)
    ended = ", ".join(f"{status}: {count}" for status, count in sorted(statuses.items(), key=str))
    worked = sum(one.worked for one in outcomes)
    longest, most = max(one.seconds for one in outcomes), max(one.most for one in outcomes) / 1e6
    print(f"{len(outcomes)} lines: {len(wrong)} wrong, {worked} went to work; exit status {ended}")
    print(f"longest {longest:.1f} s of computing, most {most:.0f} MB")
    return int(bool(wrong))


def tried(place: Path, lines: int, seed: int, seconds: float = 5.0) -> Iterator[Outcome]:
    """So many lines, one after another, in the folder `place`."""
    torch.set_num_threads(1)
    good, bad = _files(place)
    chance = random.Random(seed)
    known = commands()
    for number in range(lines):
        outcome = run(place, _line(chance, known, good, bad), seconds)
        if outcome.wrong:
            shown = shlex.join(word if len(word) < 60 else f"{word[:40]}..." for word in outcome.line)
            print(f"{number}: frida-painter {shown!a}\n    {outcome.wrong}", flush=True)
        yield outcome


def commands() -> list[Command]:
    """All commands, and what they take, as they describe it themselves."""
    found: list[Command] = []
    for entry in all_commands():
        _walk((entry.name,), entry.load(), found)
    return [one for one in found if one.path not in _LEFT_OUT]


def _walk(path: tuple[str, ...], command: Any, found: list[Command]) -> None:
    if hasattr(command, "commands"):
        for name, inner in command.commands.items():
            _walk((*path, name), inner.load() if hasattr(inner, "load") else inner, found)
        return
    parameters = []
    for one in command.params:
        takes = None if getattr(one, "is_flag", False) else one.type_descriptor.annotation
        takes = getattr(takes, "__args__", (takes,))[0]  # of a list, what is in it
        option = one.opts[0] if one.opts[0].startswith("-") else ""
        parameters.append(Parameter(option, takes, bool(one.required) or not option))
    found.append(Command(path, tuple(parameters)))


def _line(chance: random.Random, known: list[Command], good: list[str], bad: list[str]) -> list[str]:
    command = chance.choice(known)
    chosen = [one for one in command.parameters if chance.random() < (0.85 if one.needed else 0.25)]
    hostile = chance.randrange(len(chosen)) if chosen else -1
    words = list(command.path)
    for number, one in enumerate(chosen):
        if one.takes is None:
            words.append(one.name)
            continue
        value = _value(chance, one.takes, good, bad, hostile=number == hostile or chance.random() < 0.3)
        words += [one.name, value] if one.name else [value]
    return words


def _value(chance: random.Random, takes: type, good: list[str], bad: list[str], *, hostile: bool) -> str:
    if takes is Path:
        return chance.choice(bad if hostile else good)
    if takes in (int, float):
        return chance.choice(NUMBERS if hostile else ("1", "2", "3"))
    return chance.choice((*WORDS, *bad) if hostile else ("virtual", "broad", "fine", "a lemon", "svg"))


def _files(place: Path) -> tuple[list[str], list[str]]:
    """Files of every kind in `place`: the good, by name, and the bad."""
    Image.effect_noise((120, 90), 80).convert("RGB").save(place / "photo.png")
    (place / "settings.toml").write_text("strokes = 3\n")
    (place / "goal.toml").write_text('[[goal]]\nimage = "photo.png"\n')
    (place / "empty").touch()
    (place / "folder").mkdir()
    (place / "cut.png").write_bytes((place / "photo.png").read_bytes()[:900])
    (place / "heavy.toml").write_text(f'[[goal]]\nimage = "photo.png"\nweight = {"9" * 400}\n')
    (place / "odd.toml").write_text("strokes = nan\nseed = 'x'\n[paint]\nwells = [[1, nan, 3]]\n")
    (place / "deep.json").write_text("[" * 100_000)
    (place / "odd.json").write_text(
        json.dumps({"format": "frida-painter plan", "version": "1", "paints": [None, 3, {}]})
    )
    (place / "script.svg").write_text("<svg><script>alert(1)</script></svg>")
    torch.save({"a": torch.zeros(2)}, place / "pickle.safetensors")
    (place / "header.safetensors").write_bytes((2**62).to_bytes(8, "little") + b"{}")
    (place / "journal-of-nothing").mkdir()
    (place / "journal-of-nothing" / "journal").write_bytes(b"\x00" * 5000)
    with (place / "huge").open("wb") as huge:
        huge.truncate(3 * 2**30)
    os.mkfifo(place / "pipe")
    for name, target in (("zero.png", "/dev/zero"), ("to-pipe", "pipe"), ("loop", "loop"), ("nowhere", "gone/far")):
        (place / name).symlink_to(target)
    with socket.socket(socket.AF_UNIX) as listener:
        listener.bind(str(place / "socket"))
    bad = ["/dev/zero", "/dev/null", "/dev/full", "/dev/urandom", "/dev/tty", "/dev/ptmx", "/proc/self/mem",
           "/proc/kmsg", "/proc/self/pagemap", "/proc/1/environ", "", ".", "/", "..", "no/such/file", "x" * 300,
           "x" * 5000, "y/" * 3000, "\udcff", "a\nb\x1b[2J", "~nobody", "photo.png/inside"]  # fmt: skip
    bad += ["empty", "folder", "cut.png", "heavy.toml", "odd.toml", "deep.json", "odd.json", "script.svg", "pipe",
            "huge", "pickle.safetensors", "header.safetensors", "zero.png", "to-pipe", "loop", "nowhere", "socket",
            "journal-of-nothing"]  # fmt: skip
    return ["photo.png", "settings.toml", "goal.toml", "new/one.png", "new/two.svg"], bad


def run(place: Path, line: list[str], seconds: float) -> Outcome:
    """One line in a process of its own; `seconds`: for how long it may do nothing."""
    outcome = Outcome(line)
    output = place / ".said"
    child = os.fork()
    if child == 0:
        _become(place, line, output)
    try:
        _follow(child, outcome, seconds)
        if not outcome.wrong and not _all_ended(child):
            outcome.wrong = "it ended, and left processes at work"
    finally:
        with contextlib.suppress(ProcessLookupError):
            os.killpg(child, signal.SIGKILL)
    outcome.said = output.read_text("utf-8", "replace") if output.exists() else ""
    output.unlink(missing_ok=True)
    allowed = (0, 2, 3, 130, 143)
    if line[0] in ("check", "doctor"):  # whose answer may be no
        allowed = (*allowed, 1)
    if not outcome.wrong and "Traceback" in outcome.said:
        outcome.wrong = outcome.said[-1500:].strip()
    elif not outcome.wrong and outcome.status not in allowed:
        outcome.wrong = f"exit status {outcome.status}: {outcome.said[-300:].strip()}"
    return outcome


def _follow(child: int, outcome: Outcome, seconds: float) -> None:
    """Waits until it has ended, or is killed for what is wrong."""
    began, computed, since = time.monotonic(), 0.0, time.monotonic()
    asked = 0.0
    while True:
        ended, status, used = os.wait4(child, os.WNOHANG)
        if ended:
            outcome.status = os.waitstatus_to_exitcode(status)
            outcome.seconds = used.ru_utime + used.ru_stime
            return
        now, before = time.monotonic(), computed
        computed, memory = _computed(child), _memory(child)
        outcome.most = max(outcome.most, memory)
        since = now if computed > before else since
        if memory > _MAX_BYTES:
            outcome.wrong = f"it filled {memory / 1e6:.0f} MB"
        elif now - since > seconds and not asked:
            outcome.wrong = f"it did nothing for {now - since:.1f} s"
        elif asked and now - asked > _ENDING:
            outcome.wrong = f"it did not end {now - asked:.0f} s after SIGTERM"
        elif computed > _AT_WORK and not asked:
            outcome.worked, asked = True, now
            os.kill(child, signal.SIGTERM)
        if outcome.wrong:
            os.kill(child, signal.SIGKILL)
            os.waitpid(child, 0)
            return
        time.sleep(0.01 if now - began < 1 else 0.05)


def _all_ended(group: int) -> bool:
    """Whether nothing of a group of processes is left, once it had the time to end."""
    patience = time.monotonic() + _ENDING
    while time.monotonic() < patience:
        try:
            os.killpg(group, 0)
        except ProcessLookupError:
            return True
        time.sleep(0.01)
    return False


def _become(place: Path, line: list[str], output: Path) -> None:
    """The command itself, in a process that is never used again."""
    try:
        os.chdir(place)
        os.setsid()
        nowhere = os.open(os.devnull, os.O_RDONLY)
        said = os.open(output, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o644)
        for file, target in ((nowhere, 0), (said, 1), (said, 2)):
            os.dup2(file, target)
        os.environ["FRIDA_PAINTER_STOPS"] = ""
        os.environ["XDG_STATE_HOME"] = os.environ["XDG_DATA_HOME"] = str(place / "state")
        sys.argv = ["frida-painter", *line]
        status: Any = 1
        try:
            program.main()
        except SystemExit as end:
            status = end.code
        with contextlib.suppress(OSError):
            sys.stdout.flush()
            sys.stderr.flush()
        os._exit(status if isinstance(status, int) else int(status is not None))
    except BaseException:
        import traceback

        traceback.print_exc()
        sys.stderr.flush()
        os._exit(70)


def _computed(process: int) -> float:
    """Seconds of computing of a process and those that it waits for."""
    with contextlib.suppress(OSError, IndexError):
        fields = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()
        threads = Path(f"/proc/{process}/task").iterdir()
        children = [child for thread in threads for child in (thread / "children").read_text().split()]
        own = sum(map(int, fields[11:15])) / os.sysconf("SC_CLK_TCK")
        return own + sum(_computed(int(child)) for child in children)
    return 0.0


def _memory(process: int) -> int:
    """Bytes of its own that a process holds now, without what it shares with the one that it is a copy of."""
    with contextlib.suppress(OSError, IndexError):
        for row in Path(f"/proc/{process}/smaps_rollup").read_text().splitlines():
            if row.startswith("Private_Dirty:"):
                return 1024 * int(row.split()[1])
    return 0


if __name__ == "__main__":
    sys.exit(main())
