"""Picture making: words become picture files by a maker of the person's choice, before anything is planned.

The chosen picture is then a goal like any other. The folder of the pictures has `making.json` beside them, the record
of their maker, words and seeds; it follows a picture into the folder of its painting. A record may also stand beside
one picture alone, as NAME.making.json beside NAME.png. In the middle of a painting, pictures begin from its canvas
(`frida_painter_together/proposing.py`).
"""

import math
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from datetime import UTC, datetime
from itertools import count as count_up
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Protocol, runtime_checkable

import torch
from torch import Tensor
from torch.nn import functional

from frida_painter import registry
from frida_painter.canvas_size import CanvasSize
from frida_painter.errors import ConfigError, FridaError, ImageError, Interrupted, MakingFailed, PluginError
from frida_painter.frames import PixelGrid
from frida_painter.objectives.encoders.loading import EncoderRegistry
from frida_painter.planning.problem import Region
from frida_painter.runs.goal_item import MAKING, MAKING_FORMAT, MAKING_VERSION, GoalItem, name_of
from frida_painter.runs.spec import RunSpec
from frida_painter.session.opening import planning_device
from frida_painter.system import images, storage
from frida_painter.system.storage import count_of

MAX_PICTURES = 16
USUAL_PICTURES = 4
USUAL_MINUTES, MAX_MINUTES = 30.0, 24 * 60.0
MAX_BYTES = 200 * 10**6
"""Largest size of a file that a maker returns."""
CANVAS, FREE = "canvas.png", "free.png"
"""Files of the canvas that pictures begin from, and of the mask of its free part (white), beside the pictures."""
STRENGTH = 0.7
"""Change of the photograph of the canvas by a diffusion network, from 0 to 1; 1 keeps nothing of it."""
_PIXELS, _STEP = 512 * 512, 64
_SECOND = 0.5  # weight of words that a CLIP reads, relative to the picture that was made from them
_PLAIN = 3 / 255  # a picture whose channels differ less than this over all its pixels shows nothing
_STRETCH = 1.15  # largest factor between the proportions of the canvas and those of a picture that begins from it


@dataclass(frozen=True)
class PictureRequest:
    """Pictures that a maker is asked for.

    words: description of the picture, one line
    seeds: one seed for each wanted picture
    width, height: proportions of the canvas, as a size in pixels that suits many networks; multiples of 64
    folder: empty folder for the files
    device: device of the networks
    seconds: time for all pictures together
    stop_asked: True if the person has stopped the making; a maker asks at least once a second
    tell: receives a sentence about the progress
    canvas: photograph of the canvas that the pictures begin from; None before a painting
    free: mask of the same size, white if it may be painted; None if all of it may
    """

    words: str
    seeds: tuple[int, ...]
    width: int
    height: int
    folder: Path
    device: torch.device
    seconds: float
    stop_asked: Callable[[], bool] = lambda: False
    tell: Callable[[str], None] = lambda sentence: None
    canvas: Path | None = None
    free: Path | None = None

    def heed(self, who: str, until: float) -> None:
        """Raises Interrupted after a stop, and MakingFailed if that time of the monotonic clock is over."""
        if self.stop_asked():
            raise Interrupted("You stopped the making of pictures.")
        if not time.monotonic() < until:
            advice = "give it more time with --imagine-minutes, or name a quicker one"
            raise MakingFailed(f"{who} was not finished after {self.seconds:.0f} s; {advice}.")


@runtime_checkable
class PictureMaker(Protocol):
    """Open picture maker."""

    @property
    def facts(self) -> Mapping[str, str]:
        """Facts for the record: a network, a program or an address, with hashes if there are any.

        Known after `make`, at the latest.
        """
        ...

    def make(self, request: PictureRequest) -> "Sequence[Path | MakingFailed]":
        """Returns a picture file for each seed, in their order; the reason in place of one that could not be made.

        Raises MakingFailed if there is none at all, and Interrupted if the person has stopped the making.
        """
        ...


def make_each(request: PictureRequest, who: str, make: Callable[[int, Path, float], Path]) -> list[Path | MakingFailed]:
    """Returns the picture file for each seed, or the reason why there is none. Raises Interrupted.

    who: name of the program or service
    make: makes the picture of a seed, from its position in the request, an empty folder, and the time of the monotonic
    clock at which all are to be there
    """
    until, made = time.monotonic() + request.seconds, list[Path | MakingFailed]()
    for number in range(len(request.seeds)):
        folder = request.folder / str(number + 1)
        folder.mkdir()
        try:
            request.heed(who, until)
            request.tell(f"{who} makes picture {number + 1} of {len(request.seeds)}.")
            made.append(make(number, folder, until))
        except MakingFailed as fault:
            made.append(fault)
    return made


@dataclass(frozen=True)
class PictureMakerKind:
    """Picture maker that is chosen by its name.

    name: as in `--imagine NAME:TEXT`
    help: one sentence
    open: returns the maker, from the text after the colon; fetches and starts nothing; raises ConfigError
    begins_from_canvas: returns True if the maker of that text makes pictures from `PictureRequest.canvas`
    """

    name: str
    help: str
    open: Callable[[str], PictureMaker]
    begins_from_canvas: Callable[[str], bool] = lambda text: False


def require_canvas_maker(text: str) -> None:
    """Raises ConfigError if the maker "NAME:TEXT" makes no pictures from the canvas, or if there is none."""
    name, _ = open_picture_maker(text)
    kind = registry.parts(registry.PICTURE_MAKERS)[name].load(PictureMakerKind)
    if not kind.begins_from_canvas(text.partition(":")[2]):
        raise ConfigError(
            f"The picture maker {name!r} is not given the canvas here, so its pictures would not begin from it; a "
            "command takes it as {canvas}."
        )


@dataclass(frozen=True)
class SeenCanvas:
    """Canvas in the middle of a painting, from which pictures begin.

    picture: [3, H, W]
    size: of the canvas
    protected: part that no picture may change; None if there is none
    """

    picture: Tensor
    size: CanvasSize
    protected: Region | None = None

    def save(self, folder: Path) -> tuple[Path, Path | None]:
        """Writes the photograph, and a mask of its free part if the rest is protected; returns the files."""
        images.save(self.picture, folder / CANVAS)
        if self.protected is None:
            return folder / CANVAS, None
        closed = self.protected.on(PixelGrid(self.size, *self.picture.shape[1:]), widened=False)
        images.save((~closed).float().expand(3, -1, -1), folder / FREE)
        return folder / CANVAS, folder / FREE

    def take(self, picture: Tensor) -> Tensor:
        """Returns a made picture at the size of the canvas, with the protected part as it is. Raises ImageError."""
        rows, columns = self.picture.shape[1:]
        stretch = (picture.shape[2] / picture.shape[1]) / (columns / rows)
        if not 1 / _STRETCH <= stretch <= _STRETCH:
            raise ImageError(
                f"it has {picture.shape[2]} x {picture.shape[1]} pixels, and the canvas {columns} x {rows}, so that it "
                "does not show the whole canvas."
            )
        fitted = functional.interpolate(picture[None], (rows, columns), mode="bicubic", antialias=True)[0].clamp(0, 1)
        return fitted if self.protected is None else self.protected.keep_forbidden(fitted, self.picture, self.size)


def open_picture_maker(text: str) -> tuple[str, PictureMaker]:
    """Returns the name and the maker of "NAME" or "NAME:TEXT".

    Raises ConfigError if there is none, PluginError if it is broken.
    """
    name, _, argument = text.partition(":")
    known = registry.parts(registry.PICTURE_MAKERS)
    if name not in known:
        raise ConfigError(f"There is no picture maker called {name[:40]!r}; there are {', '.join(known)}.")
    with _blaming(name):
        maker = known[name].load(PictureMakerKind).open(argument)
    if not isinstance(maker, PictureMaker):
        raise PluginError(f"The picture maker {name!r} opened a {type(maker).__name__}, which makes none; mend it.")
    return name, maker


@contextmanager
def _blaming(name: str) -> Iterator[None]:
    """Turns what a maker does not foresee into a PluginError: foreign code may raise anything."""
    try:
        yield
    except FridaError:
        raise
    except Exception as failure:
        why = " ".join(f"{type(failure).__name__}: {failure}".split())[:200]
        raise PluginError(f"The picture maker {name!r} failed ({why}); mend it, or name another.") from failure


@dataclass(frozen=True)
class MadePicture:
    """One made picture.

    file: PNG file in the folder of the making
    picture: [3, H, W]
    """

    file: Path
    seed: int
    picture: Tensor


@dataclass(frozen=True)
class Making:
    """Pictures that a maker made from words.

    maker: name of the maker
    facts: what made them, by name
    pictures: those that show something, at least one
    best: index of the picture that is taken if nobody chooses
    rule: phrase that says why
    faults: sentences about pictures that were not made, or show nothing
    """

    words: str
    maker: str
    facts: Mapping[str, str]
    folder: Path
    pictures: tuple[MadePicture, ...]
    best: int
    rule: str
    faults: tuple[str, ...] = ()

    @property
    def made_by(self) -> str:
        """Name and facts in a line, without hashes."""
        return ", ".join((self.maker, *(fact for name, fact in self.facts.items() if name != "sha256")))

    def choose(self, index: int, why: str) -> Path:
        """Writes the record of the making with the chosen picture, and returns its file. Raises StorageError."""
        record: dict[str, Any] = {
            "format": MAKING_FORMAT, "version": MAKING_VERSION, "words": self.words, "maker": self.maker,
            "facts": dict(self.facts), "made": datetime.now(UTC).isoformat(timespec="seconds"),
            "pictures": [
                {"file": one.file.name, "seed": one.seed, "sha256": storage.sha256(one.file, "a made picture")}
                for one in self.pictures
            ],
            "chosen": self.pictures[index].file.name, "because": why,
        }  # fmt: skip
        if (canvas := self.folder / CANVAS).exists():
            record["canvas"] = storage.sha256(canvas, "the canvas")
        storage.write_json(self.folder / MAKING, record)
        return self.pictures[index].file


@dataclass(frozen=True)
class MakingWish:
    """Pictures that a person wants of some words: how many, each with a seed of its own, and the minutes for all."""

    words: str
    maker: str  # "NAME" or "NAME:TEXT"
    count: int = USUAL_PICTURES
    minutes: float = USUAL_MINUTES


def make_pictures(
    wish: MakingWish,
    folder: Path,
    spec: RunSpec,
    *,
    stop_asked: Callable[[], bool] = lambda: False,
    tell: Callable[[str], None] = lambda sentence: None,
    encoders: EncoderRegistry | None = None,
    canvas: SeenCanvas | None = None,
) -> Making:
    """Makes pictures from words, in a new folder; every picture is read and checked.

    spec: description of the painting, for canvas, seed and CLIP; its seed is that of the first picture
    encoders: networks that compare pictures with the words. None: the fetched ones
    canvas: canvas that the pictures begin from, in the middle of a painting
    Raises ConfigError, WeightsError if the named CLIP cannot be loaded, MakingFailed if there is no picture to paint,
    Interrupted after a stop, and StorageError.
    """
    if not 1 <= wish.count <= MAX_PICTURES:
        raise ConfigError(f"{wish.count} pictures were asked for; a making has 1 to {MAX_PICTURES}.")
    if not 0 < wish.minutes <= MAX_MINUTES:
        raise ConfigError(
            f"{wish.minutes:g} minutes were given to the making; it takes above 0 and at most {MAX_MINUTES:g}."
        )
    words, (name, opened) = wish.words, open_picture_maker(wish.maker)
    device = planning_device()
    if spec.clip is not None:  # one that cannot be loaded is told before anything is made
        encoders = encoders or EncoderRegistry(clip=spec.clip, device=device, tell=tell)
        encoders.clip()
    made = storage.new_folder(folder)
    seeds = tuple((spec.seed + number) % 2**31 for number in range(wish.count))
    faults: list[tuple[str, MakingFailed]] = []
    pictures: list[MadePicture] = []
    try:
        with TemporaryDirectory(dir=folder, prefix=".making-") as place:
            begins_from = (None, None) if canvas is None else canvas.save(folder)
            request = PictureRequest(
                words, seeds, *_size(spec), Path(place), device, 60 * wish.minutes, stop_asked, tell, *begins_from
            )
            for number, (file, made_from) in enumerate(zip(_ask(name, opened, request), seeds, strict=True), 1):
                try:
                    picture = _read(file) if canvas is None else canvas.take(_read(file))
                except ImageError as cause:
                    why = str(cause).replace(str(file), "it", 1).rstrip(".")
                    fault = f"Picture {number} of {name} cannot be painted: {why}; try other words, another --seed or "
                    faults.append((f"Picture {number} is left out: {why}.", MakingFailed(f"{fault}another maker.")))
                except MakingFailed as cause:
                    faults.append((f"Picture {number} is left out: {cause}", cause))
                else:
                    target = folder / f"{name_of(words)}-{number}.png"
                    images.save(picture, target)
                    pictures.append(MadePicture(target, made_from, picture))
        if not pictures:
            raise faults[0][1]
    except BaseException:
        with suppress(OSError):
            for left in (CANVAS, FREE):
                (folder / left).unlink(missing_ok=True)
            if made:
                folder.rmdir()  # it is empty
        raise
    left_out = tuple(sentence for sentence, _ in faults)
    for sentence in left_out:
        tell(sentence)
    best, rule = _rank([one.picture for one in pictures], encoders, request)
    return Making(words, name, dict(opened.facts), folder, tuple(pictures), best, rule, left_out)


def _ask(name: str, maker: PictureMaker, request: PictureRequest) -> list[Path | MakingFailed]:
    """Returns the files that a maker makes. Raises MakingFailed, Interrupted, and PluginError for any other failure."""
    with _blaming(name):
        files = [file if isinstance(file, MakingFailed) else Path(file) for file in maker.make(request)]
    if len(files) != (wanted := len(request.seeds)):
        made = "no picture" if not files else count_of(len(files), "picture")
        raise MakingFailed(f"{name} made {made}, and was asked for {wanted}; it makes one for each seed.")
    return files


def _size(spec: RunSpec) -> tuple[int, int]:
    """Returns width and height in pixels with about the proportions of the canvas, in whole steps."""
    aspect = min(4.0, max(0.25, spec.canvas.width / spec.canvas.height))
    width = _STEP * max(1, round(math.sqrt(_PIXELS * aspect) / _STEP))
    return width, _STEP * max(1, round(math.sqrt(_PIXELS / aspect) / _STEP))


def _read(file: Path | MakingFailed) -> Tensor:
    """Returns a made picture. Raises ImageError if it cannot be read, or shows nothing, and MakingFailed."""
    if isinstance(file, MakingFailed):
        raise file
    picture = images.load(file)
    if float((picture.amax(dim=(1, 2)) - picture.amin(dim=(1, 2))).max()) < _PLAIN:
        color = "black" if float(picture.max()) < 0.02 else "of one colour"
        raise ImageError(f"it is {color} all over.")
    return picture


def _rank(pictures: Sequence[Tensor], networks: EncoderRegistry | None, request: PictureRequest) -> tuple[int, str]:
    """Returns the index of the picture that is nearest to the words, and a phrase that tells the rule."""
    if len(pictures) == 1:
        return 0, "it is the only one"
    try:
        networks = networks or EncoderRegistry(device=request.device, tell=request.tell)
        reader = networks.reader()
    except FridaError:
        return 0, "it is the first; no network is here that compares pictures with words"
    with torch.no_grad():
        wanted = reader.embed_text(request.words)
        views = torch.stack([images.fit(picture, reader.side, reader.side) for picture in pictures])
        near = reader.embed_pictures(views.to(request.device)) @ wanted.to(request.device)
    return int(near.argmax()), f"it is the nearest to the words by {reader.name}"


def imagine(spec: RunSpec, make: Callable[[str, int], Path], networks: EncoderRegistry) -> RunSpec:
    """Returns the description with pictures in place of words.

    Words of the start become pictures of the start, and the words of the goal stay. Without words of the start, those
    of the goal become pictures of the goal, with their weights: painted by their content if a network for it is here,
    else pixel by pixel. A CLIP also reads the words, which then stay as a second term.

    make: makes the picture of words, from the words and their number, from 1
    networks: those of the painting
    Raises ConfigError if there are no words, and the errors of `make`.
    """
    table = "initial" if any(item.kind == "text" for item in spec.initial) else "goal"
    items: Sequence[GoalItem] = getattr(spec, table)
    if all(item.kind != "text" for item in items):
        raise ConfigError('--imagine makes a picture from words, and there are none; give them with --text "...".')
    kind = "semantic" if table == "goal" and networks.sees_meaning else "image"
    made: list[GoalItem] = []
    numbers = count_up(1)
    for item in items:
        if item.kind != "text":
            made.append(item)
            continue
        made.append(GoalItem(kind=kind, value=str(make(item.value, next(numbers))), weight=item.weight))
        readable = any(mark.isascii() and mark.isalpha() for mark in item.value)  # a CLIP reads no other alphabet
        if readable and table == "goal" and networks.reads_by_clip:
            made.append(item.model_copy(update={"weight": _SECOND * item.weight}))
    changes: dict[str, Any] = {table: tuple(made), "title": spec.title or spec.heading[:80]}
    return spec.with_values(**changes)


def remove_making(folder: Path) -> None:
    """Removes a making: the pictures that its record names, the record, and the folder if nothing else is in it."""
    with suppress(FridaError, OSError, KeyError, TypeError):
        for one in storage.read_json(folder / MAKING, "the record of a making")["pictures"]:
            (folder / Path(one["file"]).name).unlink(missing_ok=True)
        (folder / MAKING).unlink()
        folder.rmdir()
