"""Packages of Debian: fetched with the person's own apt, and read as the archives that they are.

Nothing is installed and nothing in a package runs. A package is an `ar` archive with a tar inside (deb(5)).
"""

import lzma
import shutil
import tarfile
import zlib
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from gzip import GzipFile
from pathlib import Path
from typing import IO, cast

from frida_painter import storage
from frida_painter.errors import WeightsError
from frida_painter.weights.sources import Counter, Original
from frida_painter.weights.wheel import have_fetched

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
