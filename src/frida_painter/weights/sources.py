"""Where published files come from: the hub that `transformers` uses, and a framework's download site.

Each is asked once and waited for briefly: a site that cannot be reached costs seconds, not minutes.
What came of a file before a connection broke is kept, and the rest is asked for.
"""

import os
import urllib.error
import urllib.request
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from http.client import HTTPException
from pathlib import Path, PurePosixPath
from typing import Protocol

from frida_painter.errors import WeightsError

_PATIENCE = 10.0  # seconds of silence
_CHUNK = 2**18
_WRONG_RANGE = 416

Counter = Callable[[int], None]


@dataclass(frozen=True)
class Original:
    """A file as it was published.

    path: below the source's folder; where it ends in `*.ext`, all such files, packed in the order of
    their names into one archive; size: in bytes; sha256: of the file, or of that archive.
    """

    path: str
    size: int
    sha256: str

    @property
    def name(self) -> str:
        """The file's own name."""
        return PurePosixPath(self.path).name

    def in_folder(self, scratch: Path) -> Path:
        """Where it is put while it is fetched: named by its hash, so that halves of two versions never meet."""
        return scratch / self.sha256


class WeightsSource(Protocol):
    """A place that has files of weights.

    words: its name for a person; remote: whether a network is used. Sources raise WeightsError with
    the reason alone, without a full stop: it becomes part of a sentence.
    """

    @property
    def words(self) -> str:
        """Its name for a person."""

    @property
    def remote(self) -> bool:
        """Whether a network is used."""

    def transfer(self, originals: Sequence[Original]) -> int:
        """Bytes that come over the network for these files."""

    def scratch(self, originals: Sequence[Original]) -> int:
        """Bytes of disk used on the way, besides the files themselves."""

    def bring(self, originals: Sequence[Original], scratch: Path, received: Counter) -> None:
        """Puts the files where `Original.in_folder` says; tells how many bytes have come. Raises WeightsError."""


@dataclass(frozen=True)
class DownloadSite:
    """A folder on a web server.

    address: without a slash at its end.
    """

    address: str
    remote: bool = True

    @property
    def words(self) -> str:
        """Its name for a person."""
        return self.address

    def transfer(self, originals: Sequence[Original]) -> int:
        """Bytes that come over the network for these files."""
        return sum(original.size for original in originals)

    def scratch(self, originals: Sequence[Original]) -> int:
        """Bytes of disk used on the way, besides the files themselves."""
        return 0

    def bring(self, originals: Sequence[Original], scratch: Path, received: Counter) -> None:
        """Downloads the files one after the other, each from where it broke off last time. Raises WeightsError."""
        before = 0
        for original in originals:
            count = _onward(received, before)
            download(f"{self.address}/{original.path}", original.in_folder(scratch), original.size, count)
            before += original.size


@dataclass(frozen=True)
class Hub:
    """A repository of the hub that `transformers` uses, at one revision; HF_ENDPOINT and HF_HUB_OFFLINE are heeded."""

    repository: str
    revision: str
    remote: bool = True

    @property
    def words(self) -> str:
        """Its name for a person."""
        return f"{self._endpoint} ({self.repository})"

    def transfer(self, originals: Sequence[Original]) -> int:
        """Bytes that come over the network for these files."""
        return self._site.transfer(originals)

    def scratch(self, originals: Sequence[Original]) -> int:
        """Bytes of disk used on the way, besides the files themselves."""
        return self._site.scratch(originals)

    def bring(self, originals: Sequence[Original], scratch: Path, received: Counter) -> None:
        """Downloads the files at the pinned revision. Raises WeightsError."""
        if os.environ.get("HF_HUB_OFFLINE", "").upper() in ("1", "ON", "YES", "TRUE"):
            raise WeightsError("HF_HUB_OFFLINE is set")
        self._site.bring(originals, scratch, received)

    def require(self, path: str) -> None:
        """Asks for one file's head, so that a hub that is not there costs seconds. Raises WeightsError."""
        if os.environ.get("HF_HUB_OFFLINE", "").upper() in ("1", "ON", "YES", "TRUE"):
            raise WeightsError("HF_HUB_OFFLINE is set")
        request = urllib.request.Request(f"{self._site.address}/{path}", method="HEAD")
        try:
            urllib.request.urlopen(request, timeout=_PATIENCE).close()
        except urllib.error.HTTPError as cause:
            raise WeightsError(f"{self.words} answers {cause.code} {cause.reason}") from cause
        except (TimeoutError, HTTPException, urllib.error.URLError, ConnectionError, ValueError) as cause:
            raise WeightsError(f"{self.words} cannot be reached ({_plain(cause)})") from cause

    @property
    def _endpoint(self) -> str:
        return os.environ.get("HF_ENDPOINT", "").rstrip("/") or "https://huggingface.co"

    @property
    def _site(self) -> DownloadSite:
        return DownloadSite(f"{self._endpoint}/{self.repository}/resolve/{self.revision}")


def download(address: str, path: Path, size: int, received: Counter) -> None:
    """Downloads `size` bytes to `path`; where a part of them is there already, only the rest.

    Never writes more than `size` bytes. Raises WeightsError; what has come is kept for the next time.
    """
    have = path.stat().st_size if path.exists() else 0
    if have == size:
        received(size)
        return
    headers = {"User-Agent": "frida-painter"} | ({"Range": f"bytes={have}-"} if have else {})
    try:
        # Only addresses of the catalogue come here, and what they give is checked against its pinned hash.
        with urllib.request.urlopen(urllib.request.Request(address, headers=headers), timeout=_PATIENCE) as answer:
            have = have if answer.status == 206 else 0
            with path.open("ab" if have else "wb") as file:
                while chunk := answer.read(min(_CHUNK, size - have + 1)):
                    if have + len(chunk) > size:
                        raise WeightsError(f"it sends more than the {size} bytes that the file has")
                    file.write(chunk)
                    have += len(chunk)
                    received(have)
    except urllib.error.HTTPError as cause:
        if cause.code == _WRONG_RANGE:
            path.unlink(missing_ok=True)
        raise WeightsError(f"it answers {cause.code} {cause.reason}") from cause
    except (TimeoutError, HTTPException, urllib.error.URLError, ConnectionError) as cause:
        raise WeightsError(f"it cannot be reached ({_plain(cause)})") from cause
    if have < size:
        raise WeightsError(f"the connection broke after {have} of {size} bytes; the rest is asked for next time")


def _onward(received: Counter, before: int) -> Counter:
    """Counts on from the files before this one."""
    return lambda done: received(before + done)


def _plain(cause: Exception) -> str:
    """Why a site cannot be reached, without the numbers of the system's errors."""
    reason = cause.reason if isinstance(cause, urllib.error.URLError) else cause
    return getattr(reason, "strerror", None) or str(reason) or type(reason).__name__
