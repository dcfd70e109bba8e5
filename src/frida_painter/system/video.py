"""Video files: frames stream into an H.264 file that every browser plays."""

import contextlib
import re
import subprocess
import tempfile
from collections.abc import Sequence
from pathlib import Path

import imageio_ffmpeg
import numpy as np
from numpy.typing import NDArray

from frida_painter.errors import StorageError
from frida_painter.system import storage
from frida_painter.system.operating_system import APART

RATE, MIN_RATE = 24, 8  # frames per second of a film of motions, and the least of any film
# Without colour tags browsers show slightly wrong colours. faststart puts the index first.
_ENCODING = (
    *("-vf", "scale=out_color_matrix=bt709:out_range=tv,format=yuv420p"),
    *("-colorspace", "bt709", "-color_primaries", "bt709", "-color_trc", "bt709", "-color_range", "tv"),
    *("-c:v", "libx264", "-preset", "veryfast", "-crf", "20", "-g", "60", "-movflags", "+faststart"),
)


class VideoEncoder:
    """Encoder process that receives the same array repeatedly; its file replaces `path` at the end.

    pixels [rows, columns, 3]: the array; both sides are even
    rate: frames per second
    Raises StorageError.
    """

    def __init__(self, path: Path, pixels: NDArray[np.uint8], rate: float) -> None:
        self.running = False
        self._path = path
        self._pixels = pixels
        self._file = contextlib.ExitStack()
        rows, columns, _ = pixels.shape
        temporary = self._file.enter_context(storage.replacing(path))
        self._said = self._file.enter_context(tempfile.TemporaryFile())  # noqa: SIM115
        arriving = ("-f", "rawvideo", "-pix_fmt", "rgb24", "-s", f"{columns}x{rows}", "-r", f"{rate:.4f}", "-i", "-")
        leaving = ("-r", f"{max(rate, MIN_RATE):.4f}")
        try:
            # In a separate process group it does not receive Ctrl-C, so the film can still be finished.
            self._process = subprocess.Popen(
                (imageio_ffmpeg.get_ffmpeg_exe(), "-v", "error", "-y", *arriving, *_ENCODING, *leaving, str(temporary)),
                stdin=subprocess.PIPE,
                stdout=subprocess.DEVNULL,
                stderr=self._said,
                **APART,
            )
        except (OSError, RuntimeError) as cause:
            raise self._failure(str(cause)) from cause
        self.running = True

    def send(self) -> None:
        """Sends the present content of the array as one frame. Raises StorageError; the film is then lost."""
        assert self._process.stdin is not None
        try:
            self._process.stdin.write(self._pixels.data)
        except OSError as cause:
            raise self._failure(str(cause)) from cause
        except BaseException:
            self._failure("interrupted within a frame")
            raise

    def finish(self) -> None:
        """Waits for the encoder and moves the file to its place. Raises StorageError."""
        assert self._process.stdin is not None
        try:
            self._process.stdin.close()
            status = self._process.wait()
        except OSError as cause:
            raise self._failure(str(cause)) from cause
        if status != 0:
            raise self._failure(f"the encoder ended with status {status}")
        self.running = False
        self._file.close()

    def _failure(self, reason: str) -> StorageError:
        """Ends the process, removes its unfinished file, and returns the error."""
        if self.running:
            self.running = False
            self._process.kill()
            self._process.wait()
            if self._process.stdin is not None:
                with contextlib.suppress(OSError):
                    self._process.stdin.close()
            self._said.seek(0)
            reason = " ".join(self._said.read().decode("utf-8", "replace").split())[-200:] or reason
        failure = StorageError(f"The film {self._path} cannot be written ({reason}); is there space in its folder?")
        with contextlib.suppress(StorageError):
            self._file.__exit__(type(failure), failure, None)
        return failure


def join(parts: Sequence[Path], path: Path) -> None:
    """Joins films of `VideoEncoder` of one size into `path` without encoding them again; skips damaged ones.

    Raises StorageError; `path` then stays unchanged.
    """
    listed = "".join("file '{}'\n".format(str(part.absolute()).replace("'", "'\\''")) for part in parts)
    with storage.replacing(path) as temporary, tempfile.TemporaryDirectory() as folder:
        order = Path(folder, "parts.txt")
        order.write_text(listed, "utf-8")
        _ffmpeg(
            *("-y", "-f", "concat", "-safe", "0", "-i", str(order), "-c", "copy", "-movflags", "+faststart"),
            str(temporary),
            failing=f"The film {path} cannot be put together",
        )


def count(path: Path) -> int:
    """Returns the number of frames of a film. Raises StorageError if the file is not a film."""
    said = _ffmpeg("-i", str(path), "-c", "copy", "-f", "null", "-", failing=f"The film {path} cannot be read")
    frames = re.findall(r"frame=\s*(\d+)", said)
    if not frames:
        raise StorageError(f"The film {path} cannot be read (no picture is found in it); remove it.")
    return int(frames[-1])


def _ffmpeg(*words: str, failing: str) -> str:
    """Runs ffmpeg and returns its standard error. Raises StorageError whose message begins with `failing`."""
    command = (imageio_ffmpeg.get_ffmpeg_exe(), "-hide_banner", "-v", "error", "-stats", *words)
    try:
        done = subprocess.run(
            command,
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
            errors="replace",
            check=False,
            **APART,
        )
    except OSError as cause:
        raise StorageError(f"{failing} ({cause}).") from cause
    if done.returncode != 0:
        raise StorageError(f"{failing} ({' '.join(done.stderr.split())[-200:]}); is there space in its folder?")
    return done.stderr
