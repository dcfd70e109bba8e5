"""Making of pictures by a worker: an allowed maker makes them, and the page shows them to choose from."""

import re
import secrets
from dataclasses import replace
from pathlib import Path

from frida_painter import images
from frida_painter.canvas_size import CanvasSize
from frida_painter.errors import Interrupted
from frida_painter.runs.spec import RunSpec
from frida_painter.session.events import ProcedureProgress
from frida_painter_studio.picture_choosing import MADE, MAX_MAKINGS, MakingOrder, plain_fact
from frida_painter_studio.stop import StopWatch
from frida_painter_studio.studio_folder import Feed, PaintingFolder
from frida_painter_together.proposing import record_making
from frida_painter_words.picture_makers.making import MAX_PICTURES, Making, make_pictures, remove_making

_ROWS = 384  # of a picture for the page


def imagine(folder: PaintingFolder, feed: Feed, stop: StopWatch) -> None:
    """Makes the requested pictures, and tells the page; a stop ends the maker with all that it started.

    Raises StopPressed, MakingFailed, ConfigError and StorageError.
    """
    order = MakingOrder.load(folder)
    spec = RunSpec.of(
        goal=[{"text": order.words}], seed=order.seed, canvas=CanvasSize(order.width / 1000, order.height / 1000)
    )
    place = folder.path / MADE / secrets.token_hex(12)  # random, because everybody who knows a name may see the picture
    place.parent.mkdir(exist_ok=True)
    _forget_old(folder)
    try:
        making = make_pictures(
            order.words,
            order.maker,
            place,
            spec,
            minutes=order.minutes,
            stop_asked=lambda: stop.asked,
            tell=lambda sentence: feed.tell(ProcedureProgress(sentence)),
        )
    except Interrupted:
        stop.heed()
        raise
    shown = show_pictures(making, folder.live, place.name)
    feed.tell(record_making(without_folders(making), order.label, place.parent, shown))


def without_folders(making: Making) -> Making:
    """Returns a making whose facts name no folders of this machine, for everybody at the page."""
    return replace(making, facts={name: plain_fact(fact) for name, fact in making.facts.items()})


def show_pictures(making: Making, live: Path, secret: str) -> list[str]:
    """Writes small copies of the pictures for the page, and returns their names, which hold what nobody can guess."""
    names = [f"made-{secret}-{number}.jpg" for number, _ in enumerate(making.pictures, 1)]
    for name, one in zip(names, making.pictures, strict=True):
        rows, columns = one.picture.shape[1:]
        small = min(rows, _ROWS)
        images.save(images.fit(one.picture, small, max(1, round(columns * small / rows))), live / name)
    return names


def _forget_old(folder: PaintingFolder) -> None:
    """Removes the oldest makings. The page shows the newest ones, and the one that begins now."""
    makings = (place for place in (folder.path / MADE).iterdir() if re.fullmatch("[0-9a-f]{24}", place.name))
    for place in sorted(makings, key=lambda place: place.stat().st_mtime)[: -(MAX_MAKINGS - 1)]:
        for number in range(1, MAX_PICTURES + 1):
            (folder.live / f"made-{place.name}-{number}.jpg").unlink(missing_ok=True)
        remove_making(place)
