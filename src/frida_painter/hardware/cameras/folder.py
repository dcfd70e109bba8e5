"""`folder`: pictures that someone else puts into a folder or a file: any camera that can save a picture works."""

import time
from contextlib import suppress
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path

from frida_painter import picture_file, storage
from frida_painter.errors import CameraError, ConfigError, ImageError, StaleFrame
from frida_painter.hardware.cameras.shutter import Shutter
from frida_painter.hardware.kinds import CameraKind
from frida_painter.hardware.robot import Frame

_PARTIAL = (".part", ".partial", ".tmp", ".crdownload", ".download")  # as programs name what they still write
_POLL = 0.05
_STILL = 0.2
_WRITING = 5.0
_GRAIN = 0.02  # s, of the dates that file systems write


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
    """Implements hardware.robot.Camera.

    A picture counts as taken when it says so itself (EXIF), or when its file was written, less the lag, whichever
    is earlier, and not when a file of that name came: an old picture may be moved in. A date that lies ahead is
    believed only of a file that came while it was waited for, as of then. A copy of a picture that lies there is not
    taken, nor one that was taken before, by whatever name. A file that is still being written is waited for.
    """

    def __init__(self, settings: FolderSettings) -> None:
        self.settings = settings
        self._shutter = Shutter(f"the camera that fills {str(settings.path)!r}")
        self._refused = ""  # why the picture that came last was not taken

    def connect(self) -> None:
        """Looks whether there is such a folder, or one for such a file. Raises CameraError."""
        path = self.settings.path
        if not (path.is_dir() or (path.suffix.lower() in picture_file.SUFFIXES and path.parent.is_dir())):
            raise CameraError(
                f"{str(path)!r} is no folder, nor a picture in one; give the folder into which your camera's pictures "
                f"come, or a file that it overwrites ({', '.join(picture_file.SUFFIXES)})."
            )
        self._shutter.opened()

    def capture(self, newer_than: float) -> Frame:
        """Waits for a picture that was written after `newer_than` (s, monotonic) and is not the last one again.

        Raises StaleFrame where none came in time, and CameraError where what came is damaged.
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
        """Waits for pictures no more."""
        self._shutter.closed()

    def _frame(self, file: _File, captured_at: float, newer_than: float) -> Frame | None:
        """The photograph in a file; None where it is not whole yet, has changed meanwhile, or is an old one."""
        from frida_painter import images  # whoever only asks for this camera's name reads no picture

        time.sleep(_STILL)
        if _looked_at(file.path) != file:
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
        """Raises CameraError if a picture came, other than those known, that cannot be used, `age` seconds ago or more.

        Until then the same picture may come in a kind that can: cameras write raw photographs beside JPEG.
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
        """The name of an earlier file with the same bytes; None where there is none."""
        others = [one for one in self._files() if one.size == file.size and one.path != file.path]
        content = storage.read_bytes(file.path, "a picture", file.size, ImageError) if others else b""
        for other in others:
            with suppress(ImageError):  # it has gone meanwhile
                if storage.read_bytes(other.path, "a picture", other.size, ImageError) == content:
                    return other.path.name
        return None

    def _files(self) -> list[_File]:
        """Pictures that are there, by their names, the newest first."""
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
        return [file for file in map(_looked_at, paths) if file and not file.path.name.startswith(".")]

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
    """What a file is by its first bytes; nothing if it cannot be opened."""
    with suppress(ImageError), storage.opened(file.path, "a picture", storage.MAX_BYTES, ImageError) as content:
        return picture_file.format_of(content.read(512))
    return ""


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
