"""Routes for what there is already: the gallery, files to take along, deleting."""

import io
import os
import stat
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from fastapi import APIRouter, HTTPException
from fastapi.responses import FileResponse, StreamingResponse

from frida_painter.errors import Interrupted
from frida_painter.web.feed_states import FeedStates
from frida_painter.web.folder import PaintingFolder, working
from frida_painter.web.painting_store import PaintingStore
from frida_painter.web.requests import AnySession, Operating, TheFeedStates, ThePaintingStore, TheQueue, ThisPainting
from frida_painter.web.state import PaintingState

router = APIRouter()
_PIECE = 2**18  # bytes


@router.get("/api/paintings")
def paintings(session: AnySession, store: ThePaintingStore, feeds: TheFeedStates) -> list[dict[str, Any]]:
    """All paintings, the newest first, with the picture that shows each best."""
    return cards(store, feeds)


@router.post("/api/paintings/{identifier}/delete")
def delete(entry: ThisPainting, session: Operating, store: ThePaintingStore, queue: TheQueue) -> dict[str, str]:
    """Removes a painting with all its files, for good."""
    if working(entry.folder):
        raise Interrupted("The painter is at work on this painting; stop it first.")
    queue.remove(entry.id)
    store.note(session.id, entry.id, "delete")
    store.delete(entry)
    return {"id": entry.id}


@router.get("/paintings/{identifier}/{place}/{name}")
def file(entry: ThisPainting, place: str, name: str) -> FileResponse:
    """One file of a painting, of those that are meant to be seen."""
    path = entry.folder.shown(place, name)
    if path is None:
        raise HTTPException(404, "There is no such file.")
    caching = "private, max-age=3600" if place.isdecimal() else "no-store"  # a plan stays as it is
    return FileResponse(path, headers={"Content-Disposition": "attachment", "Cache-Control": caching})


@router.get("/api/paintings/{identifier}/everything.zip")
def everything(entry: ThisPainting) -> StreamingResponse:
    """The whole painting in one file: its page, pictures, film, plan and journal."""
    folder = entry.folder.painting
    linked = folder.is_symlink() or entry.folder.path.is_symlink()
    if linked or not folder.is_dir() or working(entry.folder):
        raise HTTPException(404, "There is nothing to take along yet; wait until the painting is finished.")
    headers = {"Content-Disposition": 'attachment; filename="painting.zip"'}
    return StreamingResponse(packed(folder), media_type="application/zip", headers=headers)


class _Outlet(io.RawIOBase):
    """Holds what was written until it is taken; nobody can go back in it."""

    def __init__(self) -> None:
        super().__init__()
        self._held = bytearray()

    def writable(self) -> bool:
        return True

    def write(self, content: Any) -> int:
        self._held += content
        return len(content)

    def take(self) -> bytes:
        held, self._held = bytes(self._held), bytearray()
        return held


def packed(folder: Path) -> Iterator[bytes]:
    """A ZIP file with all that is in a folder, piece by piece; nothing is written to a disk, and no link followed."""
    outlet = _Outlet()
    with zipfile.ZipFile(outlet, "w", zipfile.ZIP_STORED) as archive:
        for path in sorted(folder.rglob("*")):
            inside = path.relative_to(folder)
            if _hidden(inside) or any((folder / part).is_symlink() for part in (inside, *inside.parents)):
                continue
            try:
                file = os.fdopen(os.open(path, os.O_RDONLY | os.O_NOFOLLOW), "rb")
            except OSError:
                continue  # it was taken away meanwhile, or may not be read
            with file:
                if not stat.S_ISREG(os.fstat(file.fileno()).st_mode):
                    continue
                about = zipfile.ZipInfo.from_file(path, Path("painting") / inside)
                with archive.open(about, "w", force_zip64=about.file_size >= 2**31) as part:
                    while content := file.read(_PIECE):
                        part.write(content)
                        yield outlet.take()
    yield outlet.take()


def _hidden(path: Path) -> bool:
    """Whether a file is one that is only needed while a painting is made, by its path inside the folder."""
    return any(part.startswith(".") for part in path.parts)


def cards(store: PaintingStore, feeds: FeedStates) -> list[dict[str, Any]]:
    """Every painting as the gallery shows it."""
    return [
        {
            "id": entry.id, "title": entry.title, "begun": entry.begun,
            "stage": feeds.seen(entry.folder, PaintingState, lambda state: state.stage),
            "working": working(entry.folder), "picture": _best_picture(entry.folder),
        }
        for entry in store.all()
    ]  # fmt: skip


def _best_picture(folder: PaintingFolder) -> str | None:
    """Where the painting, or else a plan of it, is to be seen."""
    candidates = ["painting/painting.png", *(f"{plan.number}/plan.jpg" for plan in reversed(folder.plans()))]
    for candidate in candidates:
        place, _, name = candidate.partition("/")
        if folder.shown(place, name) is not None:
            return candidate
    return None
