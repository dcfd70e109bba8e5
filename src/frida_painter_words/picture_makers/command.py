"""Picture maker `command`: a program of the person's own, which prints a picture file or writes one.

Programs run without a shell, with limits on time and size, and are ended with all that they started.
"""

import re
import shlex
import shutil
import signal
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

from frida_painter.errors import ConfigError, MakingFailed, ProcessLost
from frida_painter.system import python_process, storage
from frida_painter.system.storage import megabytes
from frida_painter_words.picture_makers.making import MAX_BYTES, PictureMakerKind, PictureRequest, make_each

_MAX_SAID = 20 * 2**20  # bytes that a program may say to its standard error
_SAID = "the words of a program"
_TOLD = 200  # characters of a program's last line in messages


def run_program(
    arguments: Sequence[str],
    name: str,
    request: PictureRequest,
    folder: Path,
    until: float,
    *,
    made: Path | None = None,
) -> None:
    """Runs a program to its end.

    arguments: the program and its arguments; no shell reads them
    name: name of the maker in messages
    folder: folder for `printed` and `said`, its standard output and standard error
    until: time of the monotonic clock at which the program is ended
    made: another file that the program writes, whose size is limited too
    Raises MakingFailed if it cannot be started, fails, or takes too long or too much room, and Interrupted after a
    stop of the request. The program is then ended, with all processes of its group.
    """
    printed, said = folder / "printed", folder / "said"
    limits = {printed: MAX_BYTES, said: _MAX_SAID, **({made: MAX_BYTES} if made else {})}

    def watch() -> None:
        request.heed(name, until)
        for file, most in limits.items():
            if _size(file) > most:
                raise MakingFailed(
                    f"{name} wrote more than {megabytes(most)} and was ended; a picture file is smaller."
                )

    with printed.open("wb") as output, said.open("wb") as complaints:
        variables = python_process.environment_of_others()
        try:
            status = python_process.watch_program(arguments, watch, stdout=output, stderr=complaints, env=variables)
        except ProcessLost as cause:
            raise MakingFailed(f"{name} cannot start {arguments[0][:80]!r} ({cause}); give one that runs.") from cause
    if status != 0:
        names = {one.value: one.name for one in signal.Signals}
        how = f"ended with status {status}" if status > 0 else f"was ended by {names.get(-status, f'signal {-status}')}"
        raise MakingFailed(f"{name} {how} and made no picture{_last_line(said)}; try it by itself, or name another.")


def _size(file: Path) -> int:
    try:
        return file.stat().st_size
    except OSError:
        return 0


def _last_line(said: Path) -> str:
    """Returns the last line that a program said, as the end of a sentence; "" if it said nothing."""
    with storage.open_checked(said, _SAID, MAX_BYTES, MakingFailed) as file:
        file.seek(max(0, _size(said) - 4096))
        lines = [plain_line(line) for line in file.read().decode("utf-8", "replace").split("\n")]
    last = next(filter(None, reversed(lines)), "")
    return f"; it said: {last[:_TOLD].rstrip('.')}" if last else ""


def plain_line(text: str) -> str:
    """Returns a foreign text in one line that can be printed."""
    return " ".join("".join(mark if mark.isprintable() else " " for mark in text).split())


_PLACES = ("words", "seed", "width", "height", "out", "canvas", "free")
_PLACE = re.compile("{(" + "|".join(_PLACES) + ")}")
_WORDS = re.compile(r"[\w.,:=/@+-]*{words}")  # with more around it, a shell could read the words as commands
_EXAMPLE = "command:my-maker --prompt {words} --seed {seed} --out {out}"


@dataclass(frozen=True)
class CommandMaker:
    """Program that is run once for each picture.

    arguments: the program and its arguments. {words}, {seed}, {width}, {height} and {out}, the file to write, are
    filled in; in a painting also {canvas}, a photograph of it, and {free}, a mask of its free part (white).
    Both are empty if there is none. {words} ends an argument, which has no space. Without it, the words are the last
    argument; without {out}, the program prints the file.
    facts: program, arguments and the hash of its file
    """

    arguments: tuple[str, ...]
    facts: Mapping[str, str] = field(default_factory=dict)

    @classmethod
    def parse(cls, text: str) -> "CommandMaker":
        """Returns the maker of a command line, which is split as by a shell. Raises ConfigError."""
        try:
            arguments = shlex.split(text)
        except ValueError as cause:
            raise ConfigError(
                f"The command {text[:80]!r} cannot be split into arguments ({cause}); close its quotes."
            ) from cause
        if not arguments or "\0" in text:
            raise ConfigError(f"The picture maker command was given no program; write {_EXAMPLE!r}.")
        program = shutil.which(arguments[0])
        if program is None:
            raise ConfigError(
                f"The program {arguments[0][:80]!r} is not here, or may not be run; give its path, as in {_EXAMPLE!r}."
            )
        mixed = next((part for part in arguments if "{words}" in part and not _WORDS.fullmatch(part)), None)
        if mixed is not None:
            raise ConfigError(
                f"The argument {mixed[:80]!r} has {{words}} in it, and a program could read them as commands; let them "
                "be an argument of their own, as in sh -c 'my-maker \"$1\"' sh {words}."
            )
        if "{words}" not in text:
            arguments.append("{words}")
        files = [path for path in map(Path, (program, *arguments[1:])) if storage.exists(path) and path.is_file()]
        hashes = " ".join(storage.sha256(path, "a program that makes pictures", ConfigError) for path in files)
        return cls((program, *arguments[1:]), {"command": shlex.join(arguments), "sha256": hashes})

    def make(self, request: PictureRequest) -> Sequence[Path | MakingFailed]:
        """Returns a picture file for each seed, or a reason. Raises Interrupted."""
        return make_each(request, Path(self.arguments[0]).name, partial(self._make_one, request))

    def _make_one(self, request: PictureRequest, number: int, folder: Path, until: float) -> Path:
        out = folder / "picture.png"
        filled = {
            "words": request.words, "seed": str(request.seeds[number]), "out": str(out),
            "width": str(request.width), "height": str(request.height),
            "canvas": str(request.canvas or ""), "free": str(request.free or ""),
        }  # fmt: skip
        arguments = [_PLACE.sub(lambda place: filled[place[1]], part) for part in self.arguments]
        run_program(arguments, "The command", request, folder, until, made=out)
        made = out if "{out}" in " ".join(self.arguments) else folder / "printed"
        if not (size := _size(made) if made.is_file() else 0):
            where = "wrote no file {out}" if made == out else "printed nothing"
            raise MakingFailed(f"The command ended well and {where}; it writes a picture file, or prints one.")
        if size > MAX_BYTES:
            raise MakingFailed(f"The command made a file of {megabytes(size)}; a picture file is smaller.")
        return made


COMMAND = PictureMakerKind(
    "command",
    "A program of yours that prints a picture file, or writes one to {out}; in a painting it begins from {canvas}.",
    CommandMaker.parse,
    lambda text: "{canvas}" in text,
)
