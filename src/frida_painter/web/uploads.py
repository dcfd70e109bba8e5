"""Pictures that people give: decoded, checked, and written anew, so that nothing of the file itself is kept.

A decoder has a process of its own for each picture, with limits on memory and time: what it stumbles over ends nothing
else, and takes nothing from anybody.
"""

import asyncio
import contextlib
import os
import secrets
import subprocess
import sys
from pathlib import Path

from frida_painter import storage
from frida_painter.errors import ImageError, Interrupted
from frida_painter.web.folder import require_disk

MOST_SECONDS = 30.0
_MOST_WAITING = 8
_TOO_MUCH = "The file needs more memory or time than a picture is given here; make it smaller first."


class Uploads:
    """Takes pictures into a folder, one after another."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._turn = asyncio.Lock()
        self._waiting = 0

    async def keep(self, content: bytes) -> str:
        """Puts a picture into the folder as PNG under a new id, which is returned.

        Raises ImageError, in words that name no path, for what is not a picture or is too large; StorageError;
        Interrupted where too many pictures wait already.
        """
        if self._waiting >= _MOST_WAITING:
            raise Interrupted("Many pictures are being taken in at the moment; give this one again in a while.")
        self._waiting += 1
        try:
            async with self._turn:
                return await asyncio.to_thread(keep, content, self._folder)
        finally:
            self._waiting -= 1


def keep(content: bytes, folder: Path) -> str:
    """As `Uploads.keep`, for one picture, at once."""
    if not content:
        raise ImageError("The file is empty; choose another picture.")
    identifier = secrets.token_hex(16)
    folder.mkdir(parents=True, exist_ok=True)
    require_disk(folder, 2**26)
    with storage.replacing(folder / f"{identifier}.png", mode=0o600) as temporary, temporary.open("wb") as decoded:
        environment = {**os.environ, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "VIPS_CONCURRENCY": "1"}
        try:
            done = subprocess.run(
                [sys.executable, "-m", "frida_painter.web.decoder"], input=content, stdout=decoded,
                stderr=subprocess.PIPE, timeout=MOST_SECONDS, env=environment, start_new_session=True,
            )  # fmt: skip
        except subprocess.TimeoutExpired:
            raise ImageError(_TOO_MUCH) from None
        if done.returncode == 2:
            raise ImageError(done.stderr.decode(errors="replace").strip().replace("\n", " "))
        if done.returncode != 0:
            with contextlib.suppress(OSError):
                print(done.stderr.decode(errors="replace")[-2000:], file=sys.stderr)
            raise ImageError(_TOO_MUCH)
    return identifier
