"""The camera kind `folder`: photographs that another program saves to a folder or to a file."""

import time
from contextlib import suppress
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path

from frida_painter import picture_file, storage
from frida_painter.errors import CameraError, ConfigError, ImageError, StaleFrame
from frida_painter.hardware.kinds import CameraKind
from frida_painter.hardware.robot import Frame
from frida_painter_drivers.cameras.shutter import Shutter

_PARTIAL = (
    ".part",
    ".partial",
    ".tmp",
    ".crdownload",
    ".download",
)  # suffixes of incomplete files
_POLL = 0.05
_STILL = 0.2
_WRITING = 5.0
_GRAIN = 0.02  # s, resolution of the dates that file systems write


@dataclass(frozen=True)
class FolderSettings:
    """Settings of a folder camera.

    path: the folder that receives the pictures, or the one file that is overwritten
    patience: seconds to wait for a new picture, above 0 to 3600
    lag: greatest delay between the exposure and the writing of the file, seconds, 0 to 60

    Raises ConfigError if patience or lag is out of range.
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
    """State of a file at one moment: path, time of writing (ns since 1970) and size (bytes). A rewrite changes it."""

    path: Path
    written: int
    size: int

    @property
    def age(self) -> float:
        """Seconds since the file was written, by the system clock; negative if that time lies in the future."""
        return time.time() - self.written / 1e9


class FolderCamera:
    """Camera that reads photographs from a folder or a file. Implements hardware.robot.Camera.

    The exposure time of a picture is the earlier of its EXIF time and its time of writing, less the lag. The time
    at which the file appeared in the folder does not count, because an old picture may be moved there.
    A time of writing in the future is accepted only for a file that appeared during the wait. It then counts as
    now.
    The camera rejects copies of pictures in the folder and pictures that it gave before, under any name. It waits
    for files that are still being written.
    """

    def __init__(self, settings: FolderSettings) -> None:
        self.settings = settings
        self._shutter = Shutter(f"the camera that fills {str(settings.path)!r}")
        self._refused = ""  # reason for which the latest picture was rejected

    def connect(self) -> None:
        """Checks that the folder, or the folder of the file, exists. Raises CameraError if not."""
        path = self.settings.path
        if not (path.is_dir() or (path.suffix.lower() in picture_file.SUFFIXES and path.parent.is_dir())):
            raise CameraError(
                f"{str(path)!r} is no folder, nor a picture in one; give the folder into which your camera's pictures "
                f"come, or a file that it overwrites ({', '.join(picture_file.SUFFIXES)})."
            )
        self._shutter.mark_connected()

    def capture(self, newer_than: float) -> Frame:
        """Waits for a picture that was taken after `newer_than` (s, monotonic) and was not given before.

        Raises StaleFrame if none came in time.
        Raises CameraError if the camera is not connected, the folder cannot be read, or the new picture is damaged
        or of an unknown kind.
        """
        self._shutter.require_open()
        until = time.monotonic() + self.settings.patience
        known, self._refused = set(self._files()), ""
        strangers = set(self._all_files())
        while time.monotonic() < until:
            files = self._files()
            fresh = next((file for file in files if file not in known), None)
            grain = 0.0 if fresh is None else _GRAIN
            if fresh is None and files and files[0].age >= 0:
                fresh = files[0]
            if fresh is not None:
                captured_at = time.monotonic() - self.settings.lag - max(0.0, fresh.age - grain)
                if captured_at <= newer_than:
                    self._refused = f"{fresh.path.name} was written {fresh.age:.0f} s before it was looked for"
                elif frame := self._frame(fresh, captured_at, newer_than):
                    return frame
            known.update(files)
            self._require_usable(strangers, _WRITING)
            time.sleep(_POLL)
        self._require_usable(strangers, 0)
        raise StaleFrame(self._nothing_new())

    def close(self) -> None:
        """Marks the camera as closed."""
        self._shutter.mark_disconnected()

    def _frame(self, file: _File, captured_at: float, newer_than: float) -> Frame | None:
        """Returns the photograph in a file; None if the file is incomplete, has changed, or holds an old picture."""
        from frida_painter import (
            images,
        )  # not at module level: listing the camera kinds must not load the picture libraries

        time.sleep(_STILL)
        if _look_at(file.path) != file:
            return None
        try:
            exposed = picture_file.exposure_time(file.path)
            if exposed is not None and exposed <= time.time():
                captured_at = min(captured_at, time.monotonic() - (time.time() - exposed) - self.settings.lag)
            if captured_at <= newer_than:
                self._refuse(f"{file.path.name} was exposed {_moment(exposed)} by the camera's own clock")
                return None
            if (other := self._original(file)) is not None:
                self._refuse(f"{file.path.name} is a copy of {other}")
                return None
            image = images.to_uint8(images.load(file.path))
        except ImageError as damage:
            if 0 <= file.age < _WRITING:
                return self._frame(file, captured_at, newer_than)
            raise CameraError(f"The newest picture cannot be used: {damage}") from damage
        if self._shutter.knows(image):
            self._refuse(f"{file.path.name} shows, byte for byte, what was photographed before")
            return None
        return self._shutter.frame(image, captured_at, newer_than)

    def _require_usable(self, known: set[_File], age: float) -> None:
        """Raises CameraError if an unusable picture came that is not in `known`, at least `age` seconds ago.

        The delay leaves time for the same picture in a usable format: cameras write raw photographs beside JPEG.
        """
        files = self._all_files() if self.settings.path.is_dir() else []
        usable = {file.path.stem for file in files if file.path.suffix.lower() in picture_file.SUFFIXES}
        for file in files:
            suffix = file.path.suffix.lower()
            if file in known or suffix in (*picture_file.SUFFIXES, *_PARTIAL) or file.path.stem in usable:
                continue
            if age <= file.age and picture_file.is_picture(kind := _kind(file)):
                advice = f"is {kind}; set the camera or the telephone to JPEG"
                if " " not in kind:
                    advice = f"is a {kind} picture by its content and not by its name; have it saved as .{kind.lower()}"
                raise CameraError(f"{file.path.name} came and cannot be used: it {advice}.")
            if age <= file.age:
                known.add(file)

    def _refuse(self, why: str) -> None:
        self._refused = why

    def _original(self, file: _File) -> str | None:
        """Returns the name of another file with the same bytes; None if there is none."""
        others = [one for one in self._files() if one.size == file.size and one.path != file.path]
        content = storage.read_bytes(file.path, "a picture", file.size, ImageError) if others else b""
        for other in others:
            with suppress(ImageError):  # the file was deleted meanwhile
                if storage.read_bytes(other.path, "a picture", other.size, ImageError) == content:
                    return other.path.name
        return None

    def _files(self) -> list[_File]:
        """Returns the picture files that exist, the newest first."""
        found = [file for file in self._all_files() if file.path.suffix.lower() in picture_file.SUFFIXES]
        return sorted(found, key=lambda file: (-file.written, file.path.name))

    def _all_files(self) -> list[_File]:
        path = self.settings.path
        try:
            paths = list(path.iterdir()) if path.is_dir() else [path]
        except OSError as gone:
            raise CameraError(
                f"The folder {str(path)!r} cannot be read any more ({gone.strerror}); look at it."
            ) from gone
        return [file for file in map(_look_at, paths) if file and not file.path.name.startswith(".")]

    def _nothing_new(self) -> str:
        newest = next(iter(self._files()), None)
        if newest is None:
            there = "there is none"
        elif newest.age < 0:
            there = f"the newest, {newest.path.name}, is dated {-newest.age:.0f} s ahead of this computer's clock"
        else:
            there = f"the newest, {newest.path.name}, is {newest.age:.0f} s old"
        by_clock = "clock" in self._refused or "written" in self._refused
        clocks = " If that is not so, set the clocks of camera and computer to the same time." if by_clock else ""
        refused = f" {self._refused}." if self._refused else ""
        return (
            f"No new picture came from {self._shutter.name} in {self.settings.patience:g} s; {there}. Take one after "
            f"the arm has gone aside, and look whether the camera still saves them there.{refused}{clocks}"
        )


def _moment(when: float | None) -> str:
    return "before" if when is None else f"on {datetime.fromtimestamp(when):%Y-%m-%d at %H:%M:%S}"


def _kind(file: _File) -> str:
    """Returns the format of a file according to its first bytes; "" if it cannot be opened."""
    with suppress(ImageError), storage.open_checked(file.path, "a picture", storage.MAX_BYTES, ImageError) as content:
        return picture_file.format_of(content.read(512))
    return ""


def _look_at(path: Path) -> _File | None:
    try:
        facts = path.stat()
    except OSError:
        return None
    return _File(path, facts.st_mtime_ns, facts.st_size) if facts.st_size else None


def _open(where: str) -> FolderCamera:
    if not where:
        raise ConfigError("'folder' was given without where it is; write folder:PATH.")
    return FolderCamera(FolderSettings(storage.in_home(where)))


KIND = CameraKind(
    "folder", "folder:PATH", "a folder into which pictures come from anywhere, or a file", open=_open, is_path=True
)
