"""The print of the studio's canvas, judged by numpy and Pillow against the simulated cells."""

import numpy as np
import pytest
from PIL import Image

from frida_painter.canvas_size import CanvasSize

from .hand import Hand

YELLOW, BLUE, BLACK = [0.98, 0.85, 0.1], [0.1, 0.3, 0.72], [0.05, 0.05, 0.05]
PIXELS = 1000


def painted(**settings):
    """A studio with six strokes, some across others and over the edge."""
    hand = Hand(YELLOW, BLUE, BLACK, brush="broad", **settings)
    width, height = hand.studio.canvas.width / 1000, hand.studio.canvas.height / 1000
    for number, well in enumerate((0, 1, 2, 1, 0, 2)):
        hand.dip(well)
        hand.stroke(0.1 * width, height * (0.1 + 0.15 * number), 0.8 * width, angle=0.2, bend=0.1 * height)
        hand.clean()
    return hand.studio


def printed(studio):
    return studio.easel.operator.print_canvas()


def test_a_print_agrees_with_the_simulated_canvas_and_no_mark_depends_on_it():
    studio, other = painted(print_pixels=PIXELS), painted()
    truth = studio.truth(180).permute(1, 2, 0).numpy()
    picture = printed(studio)
    assert max(picture.shape) >= PIXELS
    small = np.asarray(Image.fromarray(picture).resize(truth.shape[1::-1], Image.Resampling.BOX), float) / 255
    assert -10 * np.log10(((small - truth) ** 2).mean()) > 30
    assert printed(other) is None
    for name in ("wet", "ground", "dry", "tooth"):
        assert getattr(studio.canvas, name).tobytes() == getattr(other.canvas, name).tobytes()
    assert studio.canvas.reflectance().tobytes() == other.canvas.reflectance().tobytes()


def test_a_print_shows_hairs_along_the_stroke_and_threads_where_there_is_no_paint():
    hand = Hand(BLUE, brush="broad", print_pixels=PIXELS)
    bare = printed(hand.studio).astype(float)
    hand.dip(0)
    hand.stroke(0.02, 0.045, 0.08)
    stroke = printed(hand.studio).astype(float)[360:390, 450:600, 2]  # in the middle, from left to right
    across, along = np.abs(np.diff(stroke, axis=0)).mean(), np.abs(np.diff(stroke, axis=1)).mean()
    assert across > 2 * along > 0
    assert 0.3 < bare.std() < 20


def test_a_print_is_made_again_from_the_log(tmp_path):
    studio = painted(print_pixels=PIXELS, state=tmp_path / "log")
    before = printed(studio)
    studio.close()
    again = Hand(brush="broad", print_pixels=PIXELS, state=tmp_path / "log").studio
    assert (printed(again) == before).all()
    again.close()


@pytest.mark.parametrize(
    ("canvas", "ground"),
    [
        (CanvasSize(0.05, 0.04), (1.0, 1.0, 1.0)),
        (CanvasSize(2.0, 1.5), (0.02, 0.02, 0.02)),
        (CanvasSize(0.05, 0.5), (0.0, 0.0, 0.0)),
    ],
)
def test_any_canvas_can_be_printed(canvas, ground):
    studio = Hand(BLACK, canvas=canvas, ground=ground, print_pixels=PIXELS, cell=None).studio
    picture = printed(studio)
    rows, columns, _ = picture.shape
    assert max(rows, columns) >= PIXELS
    assert rows / columns == pytest.approx(canvas.height / canvas.width, rel=0.03)
    assert np.abs(picture.mean((0, 1)) / 255 - studio.truth(100).mean((1, 2)).numpy()).max() < 0.02
