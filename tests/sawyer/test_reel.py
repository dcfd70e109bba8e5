import subprocess

import imageio_ffmpeg
import numpy as np
import pytest

from frida_painter.errors import StorageError
from frida_painter.system import video
from frida_painter_drivers.sawyer.arm_film import Reel

ROWS, COLUMNS = 32, 48


def record_run(path, shades, *, killed=False):
    """Films one picture of each grey; killed: never ends."""
    pixels = np.zeros((ROWS, COLUMNS, 3), np.uint8)
    reel = Reel(path, pixels)
    before = reel.count
    for shade in shades:
        pixels[:] = shade
        reel.send()
    if killed:
        reel._encoder._failure("killed")
    else:
        reel.finish()
    return before


def shades(path):
    """The grey of every picture of a film."""
    decoding = (imageio_ffmpeg.get_ffmpeg_exe(), "-v", "error", "-i", str(path), "-f", "rawvideo", "-pix_fmt", "gray")
    content = subprocess.run((*decoding, "-fps_mode", "passthrough", "-"), capture_output=True, check=True).stdout
    return np.frombuffer(content, np.uint8).reshape(-1, ROWS * COLUMNS).mean(1).round().astype(int).tolist()


def test_two_sittings_are_one_film(tmp_path):
    path = tmp_path / "it's the arm.mp4"
    first, second = [20 + k for k in range(60)], [120 + k for k in range(30)]
    assert record_run(path, first) == 0
    alone = shades(path)
    assert len(alone) == 60 + 48 and len(set(alone[59:])) == 1, "it rests on its last picture"
    assert record_run(path, second) == 60
    seen = shades(path)
    assert len(seen) == 60 + 30 + 48 == video.count(path)
    np.testing.assert_allclose(seen[:90], [*first, *second], atol=2)


def test_of_a_killed_sitting_all_is_kept_but_its_last_piece(tmp_path):
    path = tmp_path / "arm.mp4"
    record_run(path, [30] * 100, killed=True)
    assert not path.exists()
    assert record_run(path, [200] * 5) == 96
    seen = shades(path)
    assert len(seen) == 96 + 5 + 48
    np.testing.assert_allclose(seen[:96], 30, atol=2)


def test_a_sitting_in_which_nothing_was_seen_leaves_the_film_as_it_is(tmp_path):
    path = tmp_path / "arm.mp4"
    record_run(path, [30] * 5)
    before = path.read_bytes()
    record_run(path, [])
    assert path.read_bytes() == before


def test_what_is_no_film_is_refused_and_nothing_is_replaced(tmp_path):
    path, bad = tmp_path / "arm.mp4", tmp_path / ".arm" / "000002.mp4"
    record_run(path, [30] * 2)
    before = path.read_bytes()
    bad.write_bytes(b"no film")
    with pytest.raises(StorageError, match=r"000002\.mp4 cannot be read"):
        record_run(path, [40] * 2)
    with pytest.raises(StorageError, match="cannot be put together"):
        video.join([tmp_path / "gone.mp4"], path)
    assert path.read_bytes() == before
