"""Painting together by words: in a pause, a picture maker proposes pictures that begin from the canvas as it is.

The person chooses one, and the rest is planned towards it, or goes on without. The pictures, the canvas that they
begin from and the record of their making lie in `changes/N` of the painting's folder, and a chosen goal in the next
one. The journal has what was asked (`CommandTaken`), and what was made and chosen (`CommandDone`),
each before the person hears of it, so that a painting that breaks off in between goes on from there.
"""

import json
import secrets
import select
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
from frida_painter.session.events import CommandDone, CommandTaken, DrawnRegion, MadePictures, NewGoal
from frida_painter.session.loop import PaintingSession
from frida_painter.session.observer import PHOTOGRAPH_ROWS
from frida_painter.system import images, storage
from frida_painter_cli.options import read_line
from frida_painter_words.picture_makers.making import (
    USUAL_MINUTES,
    USUAL_PICTURES,
    Making,
    MakingWish,
    SeenCanvas,
    make_pictures,
    require_canvas_maker,
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
    What is protected stays in the pictures as it is. Raises ConfigError if the painting has no goal or the maker takes
    no canvas, CameraError, and the errors of `make_pictures`.
    """
    require_goal(session)
    require_canvas_maker(maker)
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


def pursue(
    session: PaintingSession,
    folder: Path,
    wanted: RunSpec,
    wish: dict[str, Any],
) -> None:
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

_ASK = "What shall change? (Enter: paint on) "


class Proposer:
    """Talk with the person at the terminal, in the pauses of one painting.

    maker: as in `--imagine NAME:TEXT`
    stop_asked: returns True if the person stops all
    ask: shows a prompt and returns the typed line
    confirm: asks a question, and returns True for yes, which is proposed
    """

    def __init__(
        self, run: "PaintingRun", maker: str, stop_asked: Callable[[], bool], ask: Callable[[str], str],
        confirm: Callable[[str], bool],
    ) -> None:  # fmt: skip
        self._run, self._maker, self._stop_asked, self._ask, self._confirm = run, maker, stop_asked, ask, confirm
        self._typed, self._talking = "", False
        history = run.history
        # A request that names a maker came from a page.
        self._owed: dict[str, Any] = {} if history is None or "maker" in history.request else history.request
        self._proposed = None if history is None else history.proposed
        _tell(
            "To change the painting, type what shall change and press Enter, at any time."
            if sys.stdin.isatty()
            else "--propose waits for typed words, and nobody can type here."
        )

    def wants_pause(self) -> bool:
        """Returns True if the person has typed something, or if a talk broke off with the painting.

        Before the first plan there is nothing to change: what is typed waits.
        """
        so_far = None if self._run.session is None else self._run.session.so_far
        if self._talking or so_far is None or so_far.rest is None:
            return False
        if not self._typed and sys.stdin.isatty() and select.select([sys.stdin], [], [], 0)[0]:
            self._typed = read_line().strip()
        return bool(self._typed or self._owed or self._proposed)

    def talk(self) -> None:
        """Asks what shall change, until the person has nothing more to change; each trouble is one sentence."""
        self._talking = True  # what is typed while it plans again waits for the end of this talk
        try:
            self._take_up()
            while not self._stop_asked():
                typed, self._typed = self._typed, ""
                words = typed or self._ask(_ASK).strip()
                if not words:
                    return
                try:
                    self._propose(words)
                except FridaError as trouble:
                    print(trouble, file=sys.stderr)
        except (EOFError, KeyboardInterrupt) as end:
            raise Interrupted("Nobody answers any more; what was painted is kept.") from end
        finally:
            self._talking = False

    def _take_up(self) -> None:
        """Goes on with a talk that broke off: before its pictures, before the choice, or before the new plan."""
        owed, proposed, self._owed, self._proposed = self._owed, self._proposed, {}, None
        if owed.get("kind") == "choose":
            self._pursue(str(owed["file"]))
        elif owed.get("kind") == "propose":
            self._typed = str(owed["words"])
        elif proposed is not None:
            self._choose(proposed)

    def _propose(self, words: str) -> None:
        words = read_prompt(words, "The change")
        session, folder = self._run.session, self._run.folder
        assert session is not None
        session.note(CommandTaken({"kind": "propose", "words": words}))
        own = session.person.find_own_paint()
        share = 0.0 if own is None else max(1.0, 100 * float(own.mean()))
        if own is not None and self._confirm(f"You painted about {share:.0f} % of the canvas. Shall it stay as it is?"):
            forbid(session, folder, union_of(session.planner.region, own))
        try:
            making = propose(session, folder, words, self._maker, stop_asked=self._stop_asked, tell=_tell)
        except FridaError:
            session.note(CommandTaken({}))
            raise
        made = record_making(making, making.made_by, folder, [""] * len(making.pictures))
        session.note(CommandDone(made))
        self._choose(made)

    def _choose(self, made: MadePictures) -> None:
        """Asks for a picture of a making, and plans towards it; none is chosen by Enter."""
        folder, count = self._run.folder, len(made.pictures)
        _tell(f"Made from the canvas, {made.words!r}, by {made.maker}:")
        for number, one in enumerate(made.pictures, 1):
            _tell(f"  {number}  {folder / one['file']}  (seed {one['seed']})")
        prompt = f"Number of the one to paint (1 to {count}; Enter: none): "
        while line := self._ask(prompt).strip():
            if line.isdecimal() and 1 <= int(line) <= count:
                self._pursue(made.pictures[int(line) - 1]["file"])
                return
            _tell(f"Type a number from 1 to {count}, or nothing.")

    def _pursue(self, file: str) -> None:
        session, picture = self._run.session, self._run.folder / file
        assert session is not None
        session.note(CommandTaken({"kind": "choose", "file": file}))
        _tell("The rest is planned towards it, with the paints that are mixed.")
        record = storage.read_json(picture.parent / MAKING, "the record of a making")
        chosen = {"chosen": picture.name, "because": "a person chose it"}
        storage.write_json(picture.parent / MAKING, record | chosen)
        pursue(session, self._run.folder, RunSpec.of(goal=[{"image": str(picture)}]), {})
        session.note(CommandTaken({}))


def _tell(sentence: str) -> None:
    print(sentence, file=sys.stderr)
