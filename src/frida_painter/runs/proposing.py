"""Painting together by words: in a pause, a picture maker proposes pictures that begin from the canvas as it is.

The person chooses one, and the rest is planned towards it, or goes on without. The pictures, the canvas that they
begin from and the record of their making lie in `changes/N` of the painting's folder, and a chosen goal in the next
one. The journal has what was asked (`RequestTaken`), what was made (`PicturesMade`) and what was chosen
(`GoalChanged`), each before the person hears of it, so that a painting that breaks off in between goes on from there.
"""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from frida_painter import images, storage
from frida_painter.errors import ConfigError
from frida_painter.frames import PixelGrid
from frida_painter.planning.problem import Region, region_of
from frida_painter.runs.goals import open_goal
from frida_painter.runs.painting_folder import keep_goal
from frida_painter.runs.picture_making import (
    MAKING,
    USUAL_MINUTES,
    USUAL_PICTURES,
    Making,
    SeenCanvas,
    make_pictures,
    making_facts,
    require_canvas_maker,
)
from frida_painter.runs.spec import RunSpec
from frida_painter.session.loop import PaintingSession
from frida_painter.session.making_events import PicturesMade
from frida_painter.session.observer import PHOTOGRAPH_ROWS
from frida_painter.session.person_events import GoalChanged, RegionProtected

_CHANGES = "changes"
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
    maker, minutes, stop_asked, tell: as in `make_pictures`
    What is protected stays in the pictures as it is. Raises ConfigError if the painting has no goal or the maker takes
    no canvas, CameraError, and the errors of `make_pictures`.
    """
    require_goal(session)
    require_canvas_maker(maker)
    planner = session.planner
    number = storage.next_number(folder / _CHANGES, "")
    seed = (planner.seed + USUAL_PICTURES * (number - 1)) % 2**31  # other pictures each time
    return make_pictures(
        words,
        maker,
        folder / _CHANGES / str(number),
        RunSpec.of(goal=[{"text": words}], seed=seed, canvas=planner.size),
        minutes=minutes,
        stop_asked=stop_asked,
        tell=tell,
        encoders=planner.encoders,
        canvas=SeenCanvas(session.person.photograph(), planner.size, planner.region),
    )


def require_goal(session: PaintingSession) -> None:
    """Raises ConfigError if the painting has no goal that could be changed."""
    if session.in_turns:
        raise ConfigError("You draw together without a goal; begin another painting for a goal.")


def record_making(making: Making, maker: str, root: Path, shown: Sequence[str]) -> PicturesMade:
    """Writes the record of a making, with its best picture until a person chooses, and returns its event.

    maker: label of the maker
    root: folder in which the event names the pictures
    shown: file of each picture for the page
    """
    making.choose(making.best, making.rule)
    pictures = [
        {"picture": name, "file": one.file.relative_to(root).as_posix(), "seed": one.seed}
        for name, one in zip(shown, making.pictures, strict=True)
    ]
    return PicturesMade(making.words, maker, pictures, making.best, making.rule, list(making.faults))


def chosen_record(picture: Path) -> dict[str, Any]:
    """Returns the record of the making of a picture, as of the one that a person chose. Raises StorageError."""
    record = storage.read_json(picture.parent / MAKING, "the record of a making")
    return record | {"chosen": picture.name, "because": "a person chose it"}


def pursue(
    session: PaintingSession,
    folder: Path,
    wanted: RunSpec,
    wish: dict[str, Any],
    tell: Callable[[GoalChanged], None] = lambda changed: None,
) -> None:
    """Changes the goal of a painting in a pause, and replans the rest; the paints stay, because they are mixed already.

    folder: of the painting
    wish: request of the page, if there is one
    tell: hears of the change, before the rest is replanned
    Raises ConfigError if the painting has no goal, ImageError and StorageError.
    """
    require_goal(session)
    grid = PixelGrid.of_height(session.planner.size, PHOTOGRAPH_ROWS)
    kept = f"{_CHANGES}/{storage.next_number(folder / _CHANGES, '')}"
    keep_goal(wanted, folder / kept)
    goal = open_goal(wanted).fit_to(grid.rows, grid.columns)
    facts = making_facts(wanted) or wanted.goal_facts
    done = 0 if session.so_far is None else session.so_far.painted
    changed = GoalChanged(kept, wish, done, tuple(fact for _, fact in facts))
    session.note(changed)
    session.planner = session.planner.towards(goal)
    tell(changed)
    session.look_again(_ROUNDS)


def keep_region(folder: Path, drawing: Tensor) -> str:
    """Saves the drawing [3, H, W] of a region into the painting's folder; returns its name there."""
    name = f"regions/{storage.next_number(folder / 'regions', '')}.png"
    images.save(drawing, folder / name)
    return name


def forbid(
    session: PaintingSession, folder: Path, forbidden: NDArray[np.bool_], show: Callable[[Tensor], str | None]
) -> RegionProtected:
    """Forbids strokes on a part of the canvas [H, W], notes it and returns the event; nothing is replanned.

    show: writes the drawing [3, H, W] of that part for the page, and returns its name
    """
    drawing = torch.from_numpy(forbidden).float().expand(3, -1, -1)
    session.planner = session.planner.keeping_clear(region_of(drawing, only_inside=False))
    region = RegionProtected(keep_region(folder, drawing), False, show(drawing))
    session.note(region)
    return region


def union_of(region: Region | None, painted: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Returns what a region forbids, and the paint [H, W] with a small margin."""
    side = 2 * max(1, painted.shape[0] // 100) + 1
    grown = cv2.dilate(painted.astype(np.uint8), np.ones((side, side), np.uint8)) > 0
    return grown if region is None else grown | resize_mask(region.forbidden.numpy(), painted.shape)


def resize_mask(mask: NDArray[np.bool_], shape: tuple[int, ...]) -> NDArray[np.bool_]:
    """Returns a mask at another size (rows, columns)."""
    rows, columns = shape
    return cv2.resize(mask.astype(np.uint8), (columns, rows), interpolation=cv2.INTER_NEAREST) > 0
