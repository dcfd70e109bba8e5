"""Picture maker `command`: a program of the person's own, which prints a picture file or writes one."""

import re
import shlex
import shutil
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from frida_painter import storage
from frida_painter.errors import ConfigError, MakingFailed
from frida_painter_words.picture_makers.making import MAX_BYTES, PictureMakerKind, PictureRequest, make_each
from frida_painter_words.picture_makers.program import run_program

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
        until = time.monotonic() + request.seconds
        return make_each(request, lambda number: self._make_one(request, number, until))

    def _make_one(self, request: PictureRequest, number: int, until: float) -> Path:
        count = len(request.seeds)
        request.tell(f"{Path(self.arguments[0]).name} makes picture {number + 1} of {count}.")
        own = request.folder / str(number + 1)
        own.mkdir()
        printed, said, out = (own / name for name in ("printed", "said", "picture.png"))
        filled = {
            "words": request.words, "seed": str(request.seeds[number]), "out": str(out),
            "width": str(request.width), "height": str(request.height),
            "canvas": str(request.canvas or ""), "free": str(request.free or ""),
        }  # fmt: skip
        arguments = [_PLACE.sub(lambda place: filled[place[1]], part) for part in self.arguments]
        writes = any("{out}" in part for part in self.arguments)
        run_program(
            arguments, "The command", printed=printed, said=said, made=out, until=until, stop_asked=request.stop_asked
        )
        made = out if writes else printed
        size = made.stat().st_size if made.is_file() else 0
        if not size:
            where = "wrote no file {out}" if writes else "printed nothing"
            raise MakingFailed(f"The command ended well and {where}; it writes a picture file, or prints one.")
        if size > MAX_BYTES:
            raise MakingFailed(f"The command made a file of {storage.megabytes(size)}; a picture file is smaller.")
        return made


COMMAND = PictureMakerKind(
    "command",
    "A program of yours that prints a picture file, or writes one to {out}; in a painting it begins from {canvas}.",
    CommandMaker.parse,
    lambda text: "{canvas}" in text,
)
