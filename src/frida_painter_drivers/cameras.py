"""The camera kinds `opencv`, `gphoto`, `folder` and `none`.

The times of their frames are those of this computer's clock, as for real robots.
"""

import hashlib
import tempfile
import time
from abc import ABC, abstractmethod
from collections.abc import Callable
from contextlib import suppress
from datetime import datetime
from pathlib import Path
from typing import Any, NamedTuple, NoReturn, TypeVar

import numpy as np
from numpy.typing import NDArray

from frida_painter import registry
from frida_painter.errors import CameraError, ConfigError, ImageError, StaleFrame
from frida_painter.hardware.deadline import in_our_errors, within
from frida_painter.hardware.kinds import CameraKind, Needed
from frida_painter.hardware.robot import Frame
from frida_painter.system import picture_file, storage

Answer = TypeVar("Answer")


class Shutter:
    """Guard of one camera: numbers its photographs and recognises repeated ones.

    name: of the camera, in messages

    After a call that did not return, it refuses everything until the camera is connected again.
    """

    def __init__(self, name: str) -> None:
        self.name = name
        self._taken = 0
        self._known: set[bytes] = set()
        self._open = self._stuck = False

    def mark_connected(self) -> None:
        """Marks the camera as connected and forgets earlier photographs."""
        self._open, self._stuck, self._known = True, False, set()

    def mark_disconnected(self) -> None:
        """Marks the camera as disconnected."""
        self._open = False

    def require_open(self) -> None:
        """Raises CameraError if the camera is not connected, or if an earlier call into its library never returned."""
        if not self._open:
            raise CameraError(f"{self.name} is not connected; call connect() first.")
        if self._stuck:
            raise CameraError(
                f"{self.name} did not answer the last time; look at it, then close it and connect it anew."
            )

    def asking(self, what: str, call: Callable[[], Answer], seconds: float) -> Answer:
        """Returns the result of a call into a library. Raises CameraError if it fails or exceeds `seconds`."""

        def silent() -> CameraError:
            self._stuck = True
            return CameraError(
                f"{what}: {self.name} did not answer within {seconds:.0f} s; look at it and at its cable."
            )

        return in_our_errors(
            lambda: within(seconds, f"{self.name}: {what}", call),
            late=silent,
            failed=lambda why: CameraError(f"{what}: {self.name} failed ({why}); look at it."),
        )

    def knows(self, image: NDArray[np.uint8]) -> bool:
        """Returns True if an earlier photograph has the same pixels; no real camera takes one twice."""
        return _digest(image) in self._known

    def frame(self, image: object, captured_at: float, newer_than: float) -> Frame:
        """Returns the photograph [rows, columns, 3] as a frame with the next number.

        Raises StaleFrame if it was taken at `newer_than` or before, or was given before.
        Raises CameraError if `image` is no photograph.
        """
        if not isinstance(image, np.ndarray) or image.dtype != np.uint8 or image.ndim != 3 or image.shape[2] != 3:
            given = f"{image.dtype} of shape {image.shape}" if isinstance(image, np.ndarray) else type(image).__name__
            raise CameraError(f"{self.name} gave {given} for a photograph; look whether it is set to colour pictures.")
        if image.size == 0:
            raise CameraError(f"{self.name} gave a photograph without any pixels; look at it.")
        if not captured_at > newer_than:
            raise StaleFrame(
                f"{self.name} has a photograph that is {time.monotonic() - captured_at:.1f} s old, taken before the "
                "arm's last motion; take another."
            )
        if self.knows(image):
            raise StaleFrame(f"{self.name} gave the same photograph again, byte for byte; look whether it hangs.")
        self._taken += 1
        self._known.add(_digest(image))
        return Frame(np.ascontiguousarray(image), captured_at, self._taken)


def _digest(image: NDArray[np.uint8]) -> bytes:
    return hashlib.blake2b(repr(image.shape).encode() + image.tobytes(), digest_size=16).digest()


class DeviceCamera(Shutter, ABC):
    """Camera behind a library. Implements hardware.robot.Camera."""

    opening, looking = 10.0, 5.0
    """Seconds that the library may take to open the device, and to photograph or to close it."""

    def __init__(self, name: str) -> None:
        super().__init__(name)
        self._device: Any = None

    @abstractmethod
    def _open_device(self) -> Any:
        """Returns the open device."""

    @abstractmethod
    def _photograph(self) -> Any:
        """Returns a photograph that is exposed now, RGB."""

    @abstractmethod
    def _let_go(self, device: Any) -> None:
        """Closes the device."""

    def connect(self) -> None:
        """Opens the device. Raises CameraError; the message says what to install or to switch on."""
        self.close()
        self._device = self.asking("connect", self._open_device, self.opening)
        self.mark_connected()

    def capture(self, newer_than: float) -> Frame:
        """Returns a photograph that was exposed after the call. Raises CameraError, StaleFrame."""
        self.require_open()
        asked = time.monotonic()
        return self.frame(self.asking("photograph", self._photograph, self.looking), asked, newer_than)

    def close(self) -> None:
        """Closes the device. Raises CameraError if the library fails."""
        device, self._device = self._device, None
        self.mark_disconnected()
        if device is not None:
            self.asking("close", lambda: self._let_go(device), self.looking)


# Cameras that OpenCV can open, mainly webcams and V4L2 devices.

_BUFFERED = 5  # old frames that a driver may have in its buffer; V4L2 has four


class OpencvCamera(DeviceCamera):
    """Camera through OpenCV: number, path or address. Implements LiveCamera. Frames have the camera's largest size."""

    def __init__(self, device: int | str = 0) -> None:
        super().__init__(f"camera {device!r}")
        self._where = device

    def connect(self) -> None:
        """Opens the device and takes one test photograph. Raises CameraError."""
        super().connect()
        try:
            self.capture(newer_than=float("-inf"))
        except CameraError:
            self.close()
            raise
        self.mark_connected()

    def glance(self) -> NDArray[np.uint8]:
        """Returns the device's current frame [rows, columns, 3], possibly a buffered one. Raises CameraError."""
        import cv2

        self.require_open()
        seen, image = self._device.read()
        if not seen or not isinstance(image, np.ndarray):
            raise CameraError(f"{self.name} gives no picture any more; look at it and at its cable.")
        return np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2RGB), np.uint8)

    def _open_device(self) -> Any:
        import cv2

        device = cv2.VideoCapture(self._where)
        if not device.isOpened():
            device.release()
            raise CameraError(
                f"There is no camera {self._where!r}, or another program uses it; plug it in, close the other program, "
                "or give another number."
            )
        for side in (cv2.CAP_PROP_FRAME_WIDTH, cv2.CAP_PROP_FRAME_HEIGHT):
            device.set(side, 10_000)  # the camera takes the nearest size that it has
        return device

    def _photograph(self) -> Any:
        for _ in range(_BUFFERED):
            self._device.grab()
        return self.glance()

    def _let_go(self, device: Any) -> None:
        device.release()


# Cameras over USB through libgphoto2, such as the Canon EOS Rebel T7 of the paper.

_ADVICE = {  # for those error codes of libgphoto2 that a person can remedy
    -105: "no camera was found over USB; switch it on, wake it up, and look at its cable",
    -53: "another program has the camera, often the desktop's file manager; eject it there",
    -60: "the camera is locked, out of focus or full; set it to manual focus and look at its card",
    -110: "the camera is busy; wait a moment and try again",
    -1: "the camera reported an error; set it to manual focus, and switch it off and on",
}


class GphotoCamera(DeviceCamera):
    """Camera over libgphoto2: the first one found. Pictures stay on its card."""

    opening, looking = 15.0, 25.0

    def __init__(self) -> None:
        super().__init__("the camera at gphoto2")
        self._library: Any = None

    def _open_device(self) -> Any:
        with registry.importing("gphoto", "A camera over gphoto2", CameraError):
            import gphoto2
        self._library = gphoto2
        camera = gphoto2.Camera()
        camera.init()
        return camera

    def _photograph(self) -> Any:
        from frida_painter.system import (
            images,  # not at module level: listing the kinds must not load the picture libraries
        )

        place = self._device.capture(self._library.GP_CAPTURE_IMAGE)
        picture = self._device.file_get(place.folder, place.name, self._library.GP_FILE_TYPE_NORMAL)
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "photograph"
            picture.save(str(path))
            try:
                return images.to_uint8(images.load(path))
            except ImageError as error:
                raise CameraError(
                    f"The camera took {place.name!r}, which is no picture that can be read; set it to JPEG. ({error})"
                ) from error

    def _let_go(self, device: Any) -> None:
        device.exit()

    def asking(self, what: str, call: Callable[[], Answer], seconds: float) -> Answer:
        """Does as `Shutter.asking`, and adds advice for the errors that a person can remedy."""
        try:
            return super().asking(what, call, seconds)
        except CameraError as error:
            code = getattr(error.__cause__, "code", None)
            if code not in _ADVICE:
                raise
            raise CameraError(f"{what}: {_ADVICE[code]} (gphoto2 says {error.__cause__}).") from error


# Photographs that another program saves to a folder or to a file.

_PARTIAL = (".part", ".partial", ".tmp", ".crdownload", ".download")  # suffixes of incomplete files
_POLL = 0.05
_STILL = 0.2
_WRITING = 5.0
_GRAIN = 0.02  # s, resolution of the dates that file systems write


class _File(NamedTuple):
    """State of a file at one moment: path, time of writing (ns since 1970) and size (bytes). A rewrite changes it."""

    path: Path
    written: int
    size: int

    @property
    def age(self) -> float:
        """Seconds since the file was written, by the system clock; negative if that time lies in the future."""
        return time.time() - self.written / 1e9

    @property
    def is_readable(self) -> bool:
        """True if its name is that of a picture that can be read."""
        return self.path.suffix.lower() in picture_file.SUFFIXES


class FolderCamera(Shutter):
    """Camera that reads photographs from a folder, or from one file that is overwritten. Implements Camera.

    patience: seconds to wait for a new picture

    The exposure time of a picture is the earlier of its EXIF time and its time of writing. The time at which the file
    appeared in the folder does not count, because an old picture may be moved there.
    A time of writing in the future is accepted only for a file that appeared during the wait. It then counts as
    now.
    The camera rejects copies of pictures in the folder and pictures that it gave before, under any name. It waits
    for files that are still being written.
    """

    def __init__(self, path: Path, patience: float = 25.0) -> None:
        super().__init__(f"the camera that fills {str(path)!r}")
        self._path, self._patience = path, patience
        self._refused = ""  # reason for which the latest picture was rejected

    def connect(self) -> None:
        """Checks that the folder, or the folder of the file, exists. Raises CameraError if not."""
        path = self._path
        if not (path.is_dir() or (path.suffix.lower() in picture_file.SUFFIXES and path.parent.is_dir())):
            raise CameraError(
                f"{str(path)!r} is no folder, nor a picture in one; give the folder into which your camera's pictures "
                f"come, or a file that it overwrites ({', '.join(picture_file.SUFFIXES)})."
            )
        self.mark_connected()

    def capture(self, newer_than: float) -> Frame:
        """Waits for a picture that was taken after `newer_than` (s, monotonic) and was not given before.

        Raises StaleFrame if none came in time.
        Raises CameraError if the camera is not connected, the folder cannot be read, or the new picture is damaged
        or of an unknown kind.
        """
        self.require_open()
        until = time.monotonic() + self._patience
        known, self._refused = set(self._files()), ""
        strangers = set(self._all_files())
        while time.monotonic() < until:
            files = self._files()
            fresh = next((file for file in files if file not in known), None)
            grain = 0.0 if fresh is None else _GRAIN
            if fresh is None and files and files[0].age >= 0:
                fresh = files[0]
            if fresh is not None:
                captured_at = time.monotonic() - max(0.0, fresh.age - grain)
                if captured_at <= newer_than:
                    self._refused = f"{fresh.path.name} was written {fresh.age:.0f} s before it was looked for"
                elif frame := self._read(fresh, captured_at, newer_than):
                    return frame
            known.update(files)
            self._require_usable(strangers, _WRITING)
            time.sleep(_POLL)
        self._require_usable(strangers, 0)
        raise StaleFrame(self._nothing_new())

    def close(self) -> None:
        """Marks the camera as closed."""
        self.mark_disconnected()

    def _read(self, file: _File, captured_at: float, newer_than: float) -> Frame | None:
        """Returns the photograph in a file; None if the file is incomplete, has changed, or holds an old picture."""
        from frida_painter.system import images  # as in GphotoCamera

        time.sleep(_STILL)
        if _look_at(file.path) != file:
            return None
        try:
            exposed = picture_file.exposure_time(file.path)
            if exposed is not None and exposed <= time.time():
                captured_at = min(captured_at, time.monotonic() - (time.time() - exposed))
            if captured_at <= newer_than:
                when = "before" if exposed is None else f"on {datetime.fromtimestamp(exposed):%Y-%m-%d at %H:%M:%S}"
                self._refused = f"{file.path.name} was exposed {when} by the camera's own clock"
                return None
            if (other := self._find_original(file)) is not None:
                self._refused = f"{file.path.name} is a copy of {other}"
                return None
            image = images.to_uint8(images.load(file.path))
        except ImageError as damage:
            if 0 <= file.age < _WRITING:
                return self._read(file, captured_at, newer_than)
            raise CameraError(f"The newest picture cannot be used: {damage}") from damage
        if self.knows(image):
            self._refused = f"{file.path.name} shows, byte for byte, what was photographed before"
            return None
        return self.frame(image, captured_at, newer_than)

    def _require_usable(self, known: set[_File], age: float) -> None:
        """Raises CameraError if an unusable picture came that is not in `known`, at least `age` seconds ago.

        The delay leaves time for the same picture in a usable format: cameras write raw photographs beside JPEG.
        """
        files = self._all_files() if self._path.is_dir() else []
        usable = {file.path.stem for file in files if file.is_readable}
        for file in files:
            if file in known or file.path.suffix.lower() in _PARTIAL or file.path.stem in usable or file.age < age:
                continue
            kind = ""
            with (
                suppress(ImageError),
                storage.open_checked(file.path, "a picture", storage.MAX_BYTES, ImageError) as content,
            ):
                kind = picture_file.format_of(content.read(512))
            if picture_file.is_picture(kind):
                advice = f"is {kind}; set the camera or the telephone to JPEG"
                if " " not in kind:
                    advice = f"is a {kind} picture by its content and not by its name; have it saved as .{kind.lower()}"
                raise CameraError(f"{file.path.name} came and cannot be used: it {advice}.")
            known.add(file)

    def _find_original(self, file: _File) -> str | None:
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
        found = [file for file in self._all_files() if file.is_readable]
        return sorted(found, key=lambda file: (-file.written, file.path.name))

    def _all_files(self) -> list[_File]:
        path = self._path
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
            f"No new picture came from {self.name} in {self._patience:g} s; {there}. Take one after the arm has gone "
            f"aside, and look whether the camera still saves them there.{refused}{clocks}"
        )


def _look_at(path: Path) -> _File | None:
    try:
        facts = path.stat()
    except OSError:
        return None
    return _File(path, facts.st_mtime_ns, facts.st_size) if facts.st_size else None


# An easel that nobody watches: its plan is painted as it is, without looks.


class NoCamera:
    """Stand-in for a camera; implements hardware.robot.Camera. A session without a camera never asks it."""

    def connect(self) -> None:
        """Does nothing: there is nothing to connect."""

    def capture(self, newer_than: float) -> NoReturn:
        """Raises CameraError: there is no camera."""
        raise CameraError(
            "This easel has no camera (--camera none), and a photograph of the canvas is needed here; name a camera, "
            "such as --camera folder:PATH for pictures from a telephone."
        )

    def close(self) -> None:
        """Does nothing: there is nothing to disconnect."""


# The kinds.


def _open_opencv(where: str) -> OpencvCamera:
    return OpencvCamera(int(where) if where.isdigit() else where or 0)


def _open_gphoto(where: str) -> GphotoCamera:
    if where:
        raise ConfigError(f"'gphoto' was given {where[:40]!r}, and it takes the one camera at USB; write gphoto.")
    return GphotoCamera()


def _open_folder(where: str) -> FolderCamera:
    if not where:
        raise ConfigError("'folder' was given without where it is; write folder:PATH.")
    return FolderCamera(storage.in_home(where))


def _open_none(where: str) -> NoCamera:
    if where:
        raise ConfigError(f"'none' is no camera, and has no place {where[:40]!r}; write --camera none.")
    return NoCamera()


OPENCV = CameraKind("opencv", "opencv:NUMBER", "webcams and whatever OpenCV opens", open=_open_opencv)
GPHOTO = CameraKind(
    "gphoto",
    "gphoto",
    "a camera over USB that libgphoto2 knows",
    _open_gphoto,
    Needed(module="gphoto2", extra="gphoto"),
)
FOLDER = CameraKind(
    "folder", "folder:PATH", "a folder into which pictures come from anywhere, or a file", _open_folder, is_path=True
)
NONE = CameraKind("none", "none", "no camera: the plan is painted as it is, and nobody looks", open=_open_none)
