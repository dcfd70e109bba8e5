"""Painting together by words: in a pause, a picture maker proposes pictures that begin from the canvas as it is.

The person chooses one, and the rest is planned towards it, or goes on without. The pictures, the canvas that they
begin from and the record of their making lie in `changes/N` of the painting's folder, and a chosen goal in the next
one. The journal has what was asked (`CommandTaken`), and what was made and chosen (`CommandDone`),
each before the person hears of it, so that a painting that breaks off in between goes on from there.
"""

import json
import secrets
import sys
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from frida_painter.easel.kinds import REGIONS
from frida_painter.errors import ConfigError, FridaError, Interrupted
from frida_painter.frames import PixelGrid
from frida_painter.planning.problem import Region, region_of
from frida_painter.runs.goal_item import MAKING, making_facts, read_prompt
from frida_painter.runs.goals import open_goal
from frida_painter.runs.painting_folder import keep_goal
from frida_painter.runs.spec import RunSpec
from frida_painter.session.events import Advanced, CommandDone, DrawnRegion, Event, MadePictures, NewGoal
from frida_painter.session.loop import PaintingSession
from frida_painter.session.observer import PHOTOGRAPH_ROWS
from frida_painter.system import images, storage
from frida_painter.system.operating_system import is_typed
from frida_painter_cli.options import read_line
from frida_painter_together.commands import ChoosePicture, Command, Propose, command_of
from frida_painter_together.inbox import MakingOrder
from frida_painter_words.picture_makers.making import (
    USUAL_MINUTES,
    USUAL_PICTURES,
    Making,
    MakingWish,
    SeenCanvas,
    make_pictures,
)

if TYPE_CHECKING:
    from frida_painter.runs.run import PaintingRun

_CHANGES = "changes"
_SHOWN_ROWS = 384  # of a picture for the page
_ROUNDS = 3  # rounds of a replan after a change of the goal


def propose(
    session: PaintingSession,
    folder: Path,
    words: str,
    maker: str,
    *,
    minutes: float = USUAL_MINUTES,
    stop_asked: Callable[[], bool],
    tell: Callable[[str], None],
) -> Making:
    """Has pictures made that begin from the canvas, for a person who paused the painting in `folder`.

    words: what is to change
    maker, minutes: as in `MakingWish`; stop_asked, tell: as in `make_pictures`
    What is protected stays in the pictures as it is. Raises CameraError, and the errors of `make_pictures`.
    """
    planner = session.planner
    number = storage.next_number(folder / _CHANGES, "")
    seed = (planner.seed + USUAL_PICTURES * (number - 1)) % 2**31  # other pictures each time
    return make_pictures(
        MakingWish(words, maker, minutes=minutes),
        folder / _CHANGES / str(number),
        RunSpec.of(goal=[{"text": words}], seed=seed, canvas=planner.size),
        stop_asked=stop_asked,
        tell=tell,
        encoders=planner.encoders,
        canvas=SeenCanvas(session.person.photograph(), planner.size, planner.region),
    )


def require_goal(session: PaintingSession) -> None:
    """Raises ConfigError if the painting has no goal that could be changed."""
    if session.in_turns:
        raise ConfigError("You draw together without a goal; begin another painting for a goal.")


def record_making(making: Making, maker: str, root: Path, shown: Sequence[str]) -> MadePictures:
    """Writes the record of a making, with its best picture until a person chooses, and returns what is told of it.

    maker: label of the maker
    root: folder in which it names the pictures
    shown: file of each picture for the page
    """
    making.choose(making.best, making.rule)
    pictures = [
        {"picture": name, "file": one.file.relative_to(root).as_posix(), "seed": one.seed}
        for name, one in zip(shown, making.pictures, strict=True)
    ]
    return MadePictures(making.words, maker, pictures, making.best, making.rule, list(making.faults))


def without_folders(making: Making) -> Making:
    """Returns a making whose facts name no folders of this machine, for everybody at the page."""
    return replace(making, facts={name: plain_fact(fact) for name, fact in making.facts.items()})


def show_pictures(making: Making, live: Path, secret: str) -> list[str]:
    """Writes small copies of the pictures for the page, and returns their names, which hold what nobody can guess."""
    names = [f"made-{secret}-{number}.jpg" for number, _ in enumerate(making.pictures, 1)]
    for name, one in zip(names, making.pictures, strict=True):
        rows, columns = one.picture.shape[1:]
        small = min(rows, _SHOWN_ROWS)
        images.save(images.fit(one.picture, small, max(1, round(columns * small / rows))), live / name)
    return names


def plain_fact(fact: str) -> str:
    """Returns a fact about a maker without the folders of this machine, for everybody at the page."""
    words = (json.dumps(word)[1:-1] if not word.isprintable() else word for word in fact.split(" "))
    return " ".join(Path(word).name if word.lstrip("'\"").startswith("/") else word for word in words)


def choose(session: PaintingSession, folder: Path, file: str) -> None:
    """Has the painting in `folder` pursue a picture; raises as `pursue` does, ConfigError if it is not proposed."""
    made, picture = session.journal.state.wishes.proposed, folder / file
    if made is None or file not in [one["file"] for one in made.pictures]:
        raise ConfigError("This picture is not proposed any more; say again what shall change.")
    record = storage.read_json(picture.parent / MAKING, "the record of a making")
    chosen = {"chosen": picture.name, "because": "a person chose it"}
    storage.write_json(picture.parent / MAKING, record | chosen)
    pursue(session, folder, RunSpec.of(goal=[{"image": str(picture)}]), {})


def pursue(session: PaintingSession, folder: Path, wanted: RunSpec, wish: dict[str, Any]) -> None:
    """Changes the goal of a painting in a pause, and replans the rest; the paints stay, because they are mixed already.

    folder: of the painting
    wish: request of the page, if there is one
    Raises ConfigError if the painting has no goal, ImageError and StorageError.
    """
    require_goal(session)
    grid = PixelGrid.of_height(session.planner.size, PHOTOGRAPH_ROWS)
    kept = f"{_CHANGES}/{storage.next_number(folder / _CHANGES, '')}"
    keep_goal(wanted, folder / kept)
    goal = open_goal(wanted).fit_to(grid.rows, grid.columns)
    facts = making_facts(*wanted.goal, *wanted.initial) or wanted.goal_facts
    done = 0 if session.so_far is None else session.so_far.painted
    session.note(CommandDone(NewGoal(kept, wish, done, tuple(fact for _, fact in facts))))
    session.planner = session.planner.towards(goal)
    session.look_again(_ROUNDS)


def mark(session: PaintingSession, folder: Path, drawing: Tensor, *, only: bool) -> None:
    """Forbids strokes on the part of the canvas that is drawn [3, H, W], or, with `only`, all others, and notes it.

    Nothing is replanned. The drawing is kept under a name that nobody can guess, because pages show it.
    """
    session.planner = session.planner.keeping_clear(region_of(drawing, only_inside=only))
    name = f"region-{secrets.token_hex(12)}.png"
    images.save(drawing, folder / REGIONS / name)
    session.note(CommandDone(DrawnRegion(name, only)))


def forbid(session: PaintingSession, folder: Path, forbidden: NDArray[np.bool_]) -> None:
    """Forbids strokes on a part of the canvas [H, W], like `mark`."""
    mark(session, folder, torch.from_numpy(forbidden).float().expand(3, -1, -1), only=False)


def union_of(region: Region | None, painted: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Returns what a region forbids, and the paint [H, W] with a small margin."""
    side = 2 * max(1, painted.shape[0] // 100) + 1
    grown = cv2.dilate(painted.astype(np.uint8), np.ones((side, side), np.uint8)) > 0
    return grown if region is None else grown | resize_mask(region.forbidden.numpy(), painted.shape)


def resize_mask(mask: NDArray[np.bool_], shape: tuple[int, ...]) -> NDArray[np.bool_]:
    """Returns a mask at another size (rows, columns)."""
    return cv2.resize(mask.astype(np.uint8), shape[::-1], interpolation=cv2.INTER_NEAREST) > 0


# Talk with a person at the terminal


class Proposer:
    """Person at the terminal who changes the goal by words: what they type becomes commands for the conductor.

    maker: as in `--imagine NAME:TEXT`
    ask: shows a prompt and returns the typed line
    """

    def __init__(self, run: "PaintingRun", maker: str, ask: Callable[[str], str]) -> None:
        self._run, self._maker, self._ask, self._name = run, maker, ask, maker.partition(":")[0]
        self._typed, self._talks, self._ordered = "", False, ""  # ordered: words of the pictures to choose from here
        said = run.history and run.history.wishes
        owed = said and (command_of(said.request) or said.proposed)
        if isinstance(owed, Propose | MadePictures) and owed.maker == self._name:
            self._ordered, self._talks = owed.words, True
        _tell(
            "To change the painting, type what shall change and press Enter, at any time."
            if sys.stdin.isatty()
            else "--propose waits for typed words, and nobody can type here."
        )

    def hear(self, event: Event) -> None:
        """Tells the progress of a making."""
        if isinstance(event, Advanced) and event.words:
            _tell(event.words)

    def wants_pause(self) -> bool:
        """Returns True if the person has typed something; before the first plan, what is typed waits."""
        so_far = None if self._run.session is None else self._run.session.so_far
        if so_far is None or so_far.rest is None:
            return False
        if not self._typed and sys.stdin.isatty() and is_typed(sys.stdin.fileno(), 0):
            self._typed = read_line().strip()
            self._talks |= self._run.painting.wishes.paused  # by Enter alone, too
        return bool(self._typed)

    def has_word(self) -> bool:
        """Returns True if the person has something to say in this pause: about pictures, or about what shall change."""
        return self.wants_pause() or (self._talks and sys.stdin.isatty())

    def find_command(self) -> Command | None:
        """Asks until there is a command, and returns it; None if nothing more shall change. Raises Interrupted."""
        made, self._talks = self._run.painting.wishes.proposed, True
        try:
            if made is not None and made.words == self._ordered:
                self._ordered = ""
                if file := self._choose(made):
                    _tell("The rest is planned towards it, with the paints that are mixed.")
                    return ChoosePicture(file)
            while words := self._typed or self._ask("What shall change? (Enter: paint on) ").strip():
                self._typed = ""
                try:
                    self._ordered = words = read_prompt(words, "The change")
                    order = MakingOrder(words=words, maker=self._maker, label=self._name, minutes=USUAL_MINUTES)
                    order.keep(self._run.folder)
                    return Propose(words, self._name)
                except FridaError as trouble:
                    _tell(str(trouble))
        except (EOFError, KeyboardInterrupt) as end:
            raise Interrupted("Nobody answers any more; what was painted is kept.") from end
        self._talks = False
        return None

    def _choose(self, made: MadePictures) -> str:
        """Asks for a picture of a making, and returns its file; none is chosen by Enter."""
        count = len(made.pictures)
        _tell(f"Made from the canvas, {made.words!r}, by {made.maker}:")
        for number, one in enumerate(made.pictures, 1):
            _tell(f"  {number}  {self._run.folder / one['file']}  (seed {one['seed']})")
        while line := self._ask(f"Number of the one to paint (1 to {count}; Enter: none): ").strip():
            if line.isdecimal() and 1 <= int(line) <= count:
                return str(made.pictures[int(line) - 1]["file"])
            _tell(f"Type a number from 1 to {count}, or nothing.")
        return ""


def _tell(sentence: str) -> None:
    print(sentence, file=sys.stderr)
