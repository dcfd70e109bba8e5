"""Moving pictures: frames stream into an H.264 file that every browser plays."""

import contextlib
import subprocess
import tempfile
from pathlib import Path

import imageio_ffmpeg
import numpy as np
from numpy.typing import NDArray

from frida_painter import storage
from frida_painter.errors import StorageError

RATE = 24
# Colours are tagged as what they are, or browsers show them a shade off; faststart puts the index first.
_ENCODING = (
    *("-vf", "scale=out_color_matrix=bt709:out_range=tv,format=yuv420p", "-r", str(RATE)),
    *("-colorspace", "bt709", "-color_primaries", "bt709", "-color_trc", "bt709", "-color_range", "tv"),
    *("-c:v", "libx264", "-preset", "veryfast", "-crf", "20", "-g", "60", "-movflags", "+faststart"),
)


class VideoEncoder:
    """The encoder's process, fed with the same array again and again; its file replaces `path` at the end.

    pixels: the array [rows, columns, 3], both even; rate: frames a second as they arrive. Raises StorageError.
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
        try:
            # A group of its own keeps a person's Ctrl-C away from it, so that the film can still be ended.
            self._process = subprocess.Popen(
                (imageio_ffmpeg.get_ffmpeg_exe(), "-v", "error", "-y", *arriving, *_ENCODING, str(temporary)),
                stdin=subprocess.PIPE,
                stdout=subprocess.DEVNULL,
                stderr=self._said,
                start_new_session=True,
            )
        except (OSError, RuntimeError) as cause:
            raise self._failure(str(cause)) from cause
        self.running = True

    def send(self) -> None:
        """Sends the array as it is now as one frame. Raises StorageError, and the film is gone."""
        assert self._process.stdin is not None
        try:
            self._process.stdin.write(self._pixels.data)
        except OSError as cause:
            raise self._failure(str(cause)) from cause
        except BaseException:
            self._failure("interrupted within a frame")
            raise

    def finish(self) -> None:
        """Waits until all is encoded and puts the file into its place. Raises StorageError."""
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
        """Ends the process, removes its unfinished file, and says why."""
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
