"""`folder`: pictures that someone else puts into a folder or a file: any camera that can save a picture works."""

import time
from dataclasses import dataclass
from pathlib import Path

from frida_painter.errors import CameraError, ConfigError, ImageError, StaleFrame
from frida_painter.hardware.camera import Frame
from frida_painter.hardware.cameras.shutter import Shutter
from frida_painter.hardware.kinds import CameraKind

_SUFFIXES = (".jpg", ".jpeg", ".png", ".webp", ".tif", ".tiff", ".bmp")
_POLL = 0.05
_STILL = 0.2
_WRITING = 5.0


@dataclass(frozen=True)
class FolderSettings:
    """path: the folder into which pictures come, or the one file that is overwritten.

    patience: seconds to wait for a new picture; lag: seconds from the exposure to the file, as much
    as it can be. Raises ConfigError.
    """

    path: Path
    patience: float = 25.0
    lag: float = 0.0

    def __post_init__(self) -> None:
        if not (0 < self.patience <= 3600 and 0 <= self.lag <= 60):
            raise ConfigError(
                f"A camera's folder was given {self.patience} s of patience and {self.lag} s of lag; they are above 0 "
                "to 3600 s and 0 to 60 s."
            )


@dataclass(frozen=True)
class _File:
    """A file as it stood when it was looked at: what changes when it is written anew."""

    path: Path
    written: int
    size: int

    @property
    def age(self) -> float:
        """Seconds since it was written, by the clock on the wall; negative where that lies ahead."""
        return time.time() - self.written / 1e9


class FolderCamera:
    """Implements hardware.camera.Camera.

    A picture counts as taken when its file was written, less the lag. That is known for sure where
    the file appeared or changed while it was waited for; otherwise the file's date is believed, unless
    it lies ahead. A file that is still being written is waited for.
    """

    def __init__(self, settings: FolderSettings) -> None:
        self.settings = settings
        self._shutter = Shutter(f"the camera that fills {str(settings.path)!r}")

    def connect(self) -> None:
        """Looks whether there is such a folder, or one for such a file. Raises CameraError."""
        path = self.settings.path
        if not (path.is_dir() or (path.suffix.lower() in _SUFFIXES and path.parent.is_dir())):
            raise CameraError(
                f"{str(path)!r} is no folder, nor a picture in one; give the folder into which your camera's pictures "
                f"come, or a file that it overwrites ({', '.join(_SUFFIXES)})."
            )
        self._shutter.opened()

    def capture(self, newer_than: float) -> Frame:
        """Waits for a picture that was written after `newer_than` (s, monotonic) and is not the last one again.

        Raises StaleFrame where none came in time, and CameraError where what came is damaged.
        """
        self._shutter.require_open()
        until = time.monotonic() + self.settings.patience
        known = set(self._files())
        while time.monotonic() < until:
            files = self._files()
            fresh = next((file for file in files if file not in known), None)
            captured_at = time.monotonic() - self.settings.lag
            if fresh is None and files and files[0].age >= 0:
                fresh, captured_at = files[0], captured_at - files[0].age
            if fresh is not None and captured_at > newer_than:
                frame = self._frame(fresh, captured_at, newer_than)
                if frame is not None:
                    return frame
            known.update(files)
            time.sleep(_POLL)
        raise StaleFrame(self._nothing_new())

    def close(self) -> None:
        """Waits for pictures no more."""
        self._shutter.closed()

    def _frame(self, file: _File, captured_at: float, newer_than: float) -> Frame | None:
        """The photograph in a file; None where it is not whole yet, has changed meanwhile, or is the last one again."""
        from frida_painter import images  # whoever only asks for this camera's name reads no picture

        time.sleep(_STILL)
        if _looked_at(file.path) != file:
            return None
        try:
            image = images.to_uint8(images.load(file.path))
        except ImageError as damage:
            if 0 <= file.age < _WRITING:
                return self._frame(file, captured_at, newer_than)
            raise CameraError(f"The newest picture cannot be used: {damage}") from damage
        if self._shutter.is_last(image):
            return None
        return self._shutter.frame(image, captured_at, newer_than)

    def _files(self) -> list[_File]:
        """Pictures that are there, the newest first."""
        path = self.settings.path
        try:
            paths = list(path.iterdir()) if path.is_dir() else [path]
        except OSError as gone:
            raise CameraError(
                f"The folder {str(path)!r} cannot be read any more ({gone.strerror}); look at it."
            ) from gone
        found = [
            file
            for file in map(_looked_at, paths)
            if file and file.path.suffix.lower() in _SUFFIXES and not file.path.name.startswith(".")
        ]
        return sorted(found, key=lambda file: (-file.written, file.path.name))

    def _nothing_new(self) -> str:
        newest = next(iter(self._files()), None)
        if newest is None:
            there = "there is none"
        elif newest.age < 0:
            there = f"the newest, {newest.path.name}, is dated {-newest.age:.0f} s ahead of this computer's clock"
        else:
            there = f"the newest, {newest.path.name}, is {newest.age:.0f} s old"
        return (
            f"No new picture came from {self._shutter.name} in {self.settings.patience:g} s; {there}. Take one after "
            "the arm has gone aside, and look whether the camera still saves them there."
        )


def _looked_at(path: Path) -> _File | None:
    try:
        facts = path.stat()
    except OSError:
        return None
    return _File(path, facts.st_mtime_ns, facts.st_size) if facts.st_size else None


def _open(where: str) -> FolderCamera:
    if not where:
        raise ConfigError("'folder' was given without where it is; write folder:PATH.")
    return FolderCamera(FolderSettings(Path(where).expanduser()))


KIND = CameraKind(
    "folder", "folder:PATH", "a folder into which pictures come from anywhere, or a file", open=_open, is_path=True
)
