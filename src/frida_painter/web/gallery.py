"""Routes for what there is already: the gallery, files to take along, deleting."""

import tempfile
import zipfile
from pathlib import Path
from typing import Any

from fastapi import APIRouter, HTTPException
from fastapi.responses import FileResponse
from starlette.background import BackgroundTask

from frida_painter import storage
from frida_painter.errors import Interrupted
from frida_painter.web.feed import FeedReader
from frida_painter.web.folder import PaintingFolder, working
from frida_painter.web.requests import Operating, ThePaintingStore, TheQueue, ThisPainting
from frida_painter.web.state import PaintingState

router = APIRouter()


@router.get("/api/paintings")
def paintings(store: ThePaintingStore) -> list[dict[str, Any]]:
    """All paintings, the newest first, with the picture that shows each best."""
    return [
        {"id": entry.id, "title": entry.title, "begun": entry.begun, **_glance(entry.folder)} for entry in store.all()
    ]


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
def everything(entry: ThisPainting) -> FileResponse:
    """The whole painting in one file: its page, pictures, film, plan and journal."""
    if not entry.folder.painting.is_dir() or working(entry.folder):
        raise HTTPException(404, "There is nothing to take along yet; wait until the painting is finished.")
    packed = pack(entry.folder.painting)
    headers = {"Content-Disposition": 'attachment; filename="painting.zip"'}
    return FileResponse(packed, media_type="application/zip", headers=headers, background=BackgroundTask(packed.unlink))


def pack(folder: Path) -> Path:
    """A ZIP file with all that is in a folder, beside it, to be removed when it was sent. Raises StorageError."""
    try:
        with tempfile.NamedTemporaryFile(dir=folder.parent, prefix=".take-along-", delete=False) as file:
            packed = Path(file.name)
            try:
                with zipfile.ZipFile(file, "w", zipfile.ZIP_STORED) as archive:
                    for path in sorted(folder.rglob("*")):
                        inside = path.relative_to(folder)
                        if path.is_file() and not path.is_symlink() and not _hidden(inside):
                            archive.write(path, Path("painting") / inside)
            except OSError:
                packed.unlink()
                raise
    except OSError as error:
        raise storage.cannot_write(folder, error) from error
    return packed


def _hidden(path: Path) -> bool:
    """Whether a file is one that is only needed while a painting is made, by its path inside the folder."""
    return any(part.startswith(".") for part in path.parts)


def _glance(folder: PaintingFolder) -> dict[str, Any]:
    state = PaintingState()
    for event in FeedReader(folder.feed).read():
        state.hear(event)
    return {"stage": state.stage, "working": working(folder), "picture": _best_picture(folder)}


def _best_picture(folder: PaintingFolder) -> str | None:
    """Where the painting, or else a plan of it, is to be seen."""
    candidates = ["painting/painting.png", *(f"{plan.number}/plan.jpg" for plan in reversed(folder.plans()))]
    for candidate in candidates:
        place, _, name = candidate.partition("/")
        if folder.shown(place, name) is not None:
            return candidate
    return None
