import re
import subprocess
from pathlib import Path

import imageio_ffmpeg
import numpy as np
import pytest

from frida_painter.errors import StorageError
from frida_painter.report.film import HOLD, SECONDS, FilmWriter
from frida_painter.system.video import MIN_RATE, RATE

RED, BLUE = (0.8, 0.1, 0.1), (0.1, 0.1, 0.8)


def canvas(share: float, rows: int = 60, columns: int = 80) -> np.ndarray:
    """White, covered with orange from the left as far as `share`."""
    frame = np.full((rows, columns, 3), 255, np.uint8)
    frame[:, : round(share * columns)] = (220, 120, 40)
    return frame


def written(path: Path, count: int, expected: int | None = None) -> None:
    with FilmWriter(path, expected or count) as writer:
        for index in range(count):
            writer.add(canvas((index + 1) / count), (index + 1) / count, RED if index < count / 2 else BLUE)


def frames(path: Path) -> tuple[str, list[np.ndarray]]:
    """What the decoder says about a film, and 24 frames a second at a quarter of their size, [270, 480, 3]."""
    ffmpeg = imageio_ffmpeg.get_ffmpeg_exe()
    about = subprocess.run((ffmpeg, "-hide_banner", "-i", path), capture_output=True, text=True, check=False).stderr
    assert re.search(r" 1920x1080[, ]", about), about
    small = ("-vf", "scale=480:270:flags=area")
    decoding = (ffmpeg, "-v", "error", "-i", path, *small, "-r", str(RATE), "-f", "rawvideo", "-pix_fmt", "rgb24", "-")
    content = subprocess.run(decoding, capture_output=True, check=True).stdout
    return about, list(np.frombuffer(content, np.uint8).reshape(-1, 270, 480, 3))


@pytest.mark.parametrize("count", [3, 100, 1500])
def test_a_film_lasts_about_as_long_for_any_number_of_strokes(tmp_path: Path, count: int) -> None:
    written(tmp_path / "film.mp4", count)
    about, shown = frames(tmp_path / "film.mp4")
    rate = {3: MIN_RATE, 100: MIN_RATE, 1500: RATE}[count]
    assert "h264" in about and "yuv420p" in about and f" {rate} fps" in about
    lasts = len(shown) / RATE
    assert lasts == pytest.approx((min(count, SECONDS) if count < SECONDS else SECONDS) + HOLD, abs=0.5)
    assert [path.name for path in tmp_path.iterdir()] == ["film.mp4"]


def test_colors_progress_and_the_rest_on_the_last_frame(tmp_path: Path) -> None:
    written(tmp_path / "film.mp4", 60)
    _, shown = frames(tmp_path / "film.mp4")
    last, middle = shown[-1].astype(int), shown[round(SECONDS / 2 * RATE)].astype(int)
    row, columns = last.shape[0] // 2, last.shape[1]
    assert np.abs(last[row - 10, columns // 2] - (220, 120, 40)).max() < 12
    assert np.abs(middle[row - 10, columns // 4] - (220, 120, 40)).max() < 12
    assert np.abs(middle[row - 10, 3 * columns // 4] - 255).max() < 12
    assert np.abs(last - shown[-round(HOLD * RATE) + 1].astype(int)).mean() < 2
    bar = last[254:262]  # below the canvas
    red, blue = (np.abs(bar - np.array(color) * 255).max(-1) < 60 for color in (RED, BLUE))
    assert red[:, : columns // 2].any() and blue[:, columns // 2 :].any()
    assert not red[:, columns // 2 + 6 :].any() and not blue[:, : columns // 2 - 6].any()


def test_frames_that_come_late_are_shown_for_longer(tmp_path: Path) -> None:
    """A film of 60 frames of which five came: it lasts as long, and each is seen until its stroke."""
    with FilmWriter(tmp_path / "film.mp4", 60) as writer:
        for done in (0.1, 0.2, 0.6, 0.61, 1.0):
            writer.add(canvas(done), done)
    _, shown = frames(tmp_path / "film.mp4")
    assert len(shown) / RATE == pytest.approx(SECONDS + HOLD, abs=0.5)
    middle = shown[round(0.45 * SECONDS * RATE)].astype(int)
    row, columns = middle.shape[0] // 2, middle.shape[1]
    covered = np.abs(middle[row - 10] - (220, 120, 40)).max(-1) < 12
    assert covered.sum() == pytest.approx(0.6 * 320, abs=8), f"of 320 columns between the mounts of {columns}"


def test_a_browser_can_start_before_all_is_loaded(tmp_path: Path) -> None:
    written(tmp_path / "film.mp4", 5)
    content = (tmp_path / "film.mp4").read_bytes()
    assert content.index(b"moov") < content.index(b"mdat")


def test_odd_sizes_large_frames_and_frames_that_change_their_size(tmp_path: Path) -> None:
    with FilmWriter(tmp_path / "film.mp4", 3) as writer:
        writer.add(canvas(0.2, 41, 2001), 1 / 3)
        writer.add(canvas(0.5, 75, 99), 2 / 3, RED)
        writer.add(canvas(1.0, 41, 2001), 1.0)
    _, shown = frames(tmp_path / "film.mp4")
    assert len(shown) == pytest.approx((3 + HOLD) * RATE, abs=2)


def test_an_interrupted_painting_keeps_its_film(tmp_path: Path) -> None:
    with pytest.raises(KeyboardInterrupt), FilmWriter(tmp_path / "film.mp4", 100) as writer:
        for index in range(20):
            writer.add(canvas(index / 100), (index + 1) / 100)
        raise KeyboardInterrupt
    _, shown = frames(tmp_path / "film.mp4")
    assert len(shown) / RATE == pytest.approx(20 / 100 * SECONDS + HOLD, abs=0.5)


def test_without_frames_there_is_no_film(tmp_path: Path) -> None:
    with FilmWriter(tmp_path / "film.mp4", 100):
        pass
    assert list(tmp_path.iterdir()) == []


def test_more_frames_than_expected_are_no_harm(tmp_path: Path) -> None:
    written(tmp_path / "film.mp4", 30, expected=10)
    assert len(frames(tmp_path / "film.mp4")[1]) > 0


def test_an_encoder_that_dies_leaves_the_old_film_and_says_so(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "film.mp4").write_bytes(b"old")
    broken = tmp_path / "broken"
    broken.write_text("#!/bin/sh\necho 'No space left on device' >&2\nexit 1\n")
    broken.chmod(0o755)
    monkeypatch.setattr(imageio_ffmpeg, "get_ffmpeg_exe", lambda: str(broken))
    with pytest.raises(StorageError, match="No space left on device"):
        written(tmp_path / "film.mp4", 50)
    assert (tmp_path / "film.mp4").read_bytes() == b"old"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["broken", "film.mp4"]


def test_a_missing_encoder_is_said(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(imageio_ffmpeg, "get_ffmpeg_exe", lambda: str(tmp_path / "nothing"))
    with pytest.raises(StorageError, match=r"film\.mp4 cannot be written"):
        written(tmp_path / "film.mp4", 3)
    assert list(tmp_path.iterdir()) == []
