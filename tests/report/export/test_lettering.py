import numpy as np
import pytest

from frida_painter.canvas_size import CanvasSize
from frida_painter.errors import ConfigError
from frida_painter.report.vector import letter

pytest.importorskip("HersheyFonts")
A5 = CanvasSize(0.210, 0.148)


def test_a_title_stands_left_and_a_signature_right_inside_the_canvas() -> None:
    title, signature = (np.concatenate(letter(A5, *texts)) for texts in (("HILL", ""), ("", "Ada")))
    assert title[:, 0].min() == pytest.approx(0.006) and title[:, 0].max() < 0.03
    assert signature[:, 0].max() == pytest.approx(A5.width - 0.006) and signature[:, 0].min() > 0.18
    assert np.concatenate((title, signature))[:, 1].min() > 0.004
    assert len(letter(A5, "HILL", "Ada")) == len(letter(A5, "HILL")) + len(letter(A5, signature="Ada"))


def test_capitals_are_written_along_their_middle() -> None:
    bars = letter(A5, "H")
    assert len(bars) == 3, "two posts and a bar"
    assert sorted(np.round(np.ptp(bar, axis=0).max(), 4) for bar in bars)[-1] == pytest.approx(0.003, abs=0.0015)


@pytest.mark.parametrize("text", ["Löwe", "two\nlines", "雪", "a" * 300])
def test_what_the_pen_cannot_write_is_refused(text: str) -> None:
    with pytest.raises(ConfigError):
        letter(A5, text)
    assert not letter(A5, " ", "")
