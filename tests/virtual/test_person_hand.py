"""A person paints in the studio: their strokes are on its canvas, and nothing else differs by them."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from frida_painter.errors import ConfigError
from frida_painter.hardware.easel import PersonStroke
from frida_painter.virtual.camera import CameraSpec
from virtual.hand import Hand

RED, BLUE = (0.8, 0.2, 0.1), (0.1, 0.2, 0.7)


def studio(state: Path | None = None, *, fill: bool = True) -> Hand:
    colors = (RED, BLUE) if fill else ()
    return Hand(*colors, brush="fine", seed=4, state=state, camera=CameraSpec((120, 160)), cell=0.8)


def across(
    number: int, y: float, *, paint: int = 0, brush: str = "fine", press: float = 0.5, tilt: float = 0.0
) -> PersonStroke:
    """A stroke from the left to the right, metres."""
    place = np.c_[np.linspace(0.02, 0.08, 5), np.full(5, y)]
    each = np.ones(5)
    return PersonStroke(number, brush, paint, place, press * each, tilt * each, 0 * each, 1.0)


def up(number: int, x: float, *, paint: int) -> PersonStroke:
    """A stroke from below, metres."""
    stroke = across(number, 0.03, paint=paint)
    return replace(stroke, place=np.c_[np.full(5, x), np.linspace(0.01, 0.05, 5)])


@pytest.fixture
def here() -> Iterator[Hand]:
    yield studio()


def marked(here: Hand) -> np.ndarray:
    return here.studio.canvas.wet[..., 0] > 0


def test_a_stroke_lies_where_it_was_made_whatever_the_robot_believes(here: Hand) -> None:
    here.easel.operator.paint_stroke(across(1, 0.03))  # type: ignore[attr-defined]
    rows, columns = np.nonzero(marked(here))
    cell = here.studio.canvas.cell
    assert abs(rows.mean() * cell - 30) < 1.5 and abs(columns.min() * cell - 20) < 6
    assert here.studio.clock.now == 1.0, "a stroke takes time, in which paint dries"
    assert abs(here.studio.balance().missing) < 1e-3


def test_a_studio_that_is_opened_again_has_the_strokes_byte_for_byte_and_none_twice(tmp_path: Path) -> None:
    first = studio(tmp_path / "diary")
    strokes = [across(1, 0.02), up(2, 0.05, paint=1), across(3, 0.03, brush="broad", tilt=0.8)]
    for stroke in strokes:
        first.studio.person.paint(stroke)
    first.dip(0)
    first.stroke(0.02, 0.04, 0.05)
    canvas = first.studio.canvas.wet.tobytes()
    first.studio.close()
    again = studio(tmp_path / "diary", fill=False)
    assert again.studio.canvas.wet.tobytes() == canvas
    again.studio.person.paint(strokes[-1])
    assert again.studio.canvas.wet.tobytes() == canvas, "a stroke with that number is there already"
    again.studio.person.paint(across(4, 0.045))
    assert again.studio.canvas.wet.tobytes() != canvas
    assert abs(again.studio.balance().missing) < 1e-3


def test_the_robots_strokes_are_the_same_beside_a_person_as_alone(here: Hand) -> None:
    alone = studio()
    here.studio.person.paint(across(1, 0.01))
    for each in (alone, here):
        each.dip(0)
        each.stroke(0.03, 0.05, 0.04)
    half = round(35 / here.studio.canvas.cell)
    np.testing.assert_array_equal(marked(alone)[half:], marked(here)[half:])


def test_wet_paint_mixes_and_a_washed_brush_brings_none_of_it_back(here: Hand) -> None:
    person, canvas = here.studio.person, here.studio.canvas
    person.paint(across(1, 0.03, paint=0))
    clean = canvas.wet[round(30 / canvas.cell), round(50 / canvas.cell)].copy()
    person.paint(up(2, 0.05, paint=1))
    mixed = canvas.wet[round(30 / canvas.cell), round(50 / canvas.cell)]
    assert not np.allclose(clean[1:] / clean[0], mixed[1:] / mixed[0], rtol=0.05)
    before = canvas.wet.copy()
    person.paint(across(3, 0.075, paint=0))
    new = (canvas.wet[..., 0] > 0) & (before[..., 0] == 0)
    thick = new & (canvas.wet[..., 0] > 0.03)
    share = canvas.wet[thick][:, 1:] / canvas.wet[thick][:, :1]
    np.testing.assert_allclose(share, np.broadcast_to(clean[1:] / clean[0], share.shape), rtol=1e-3)


def test_a_harder_press_and_a_tilted_brush_paint_a_wider_mark() -> None:
    areas = []
    for press, tilt in ((0.1, 0.0), (0.1, 1.0), (0.9, 0.0)):
        here = studio()
        here.studio.person.paint(across(1, 0.03, press=press, tilt=tilt, brush="broad"))
        areas.append(int(marked(here).sum()))
    assert areas[0] < areas[1] < areas[2]


def test_what_the_studio_does_not_have_is_refused_and_the_canvas_stays(here: Hand) -> None:
    for stroke, sentence in (
        (across(1, 0.03, paint=2), "Well 3 has no paint; 2 wells are filled"),
        (across(1, 0.03, brush="mop"), "no brush 'mop'"),
    ):
        with pytest.raises(ConfigError, match=sentence):
            here.studio.person.paint(stroke)
    assert not marked(here).any() and here.studio.clock.now == 0


def test_a_stroke_over_the_edge_and_a_dab_are_painted_as_far_as_there_is_canvas(here: Hand) -> None:
    over = replace(across(1, 0.03), place=np.array([[-0.02, 0.03], [0.01, 0.03]] + [[0.02, 0.03]] * 3))
    here.studio.person.paint(over)
    assert marked(here)[:, :5].any()
    dab = PersonStroke(2, "fine", 0, np.array([[0.08, 0.05]]), np.array([0.7]), np.zeros(1), np.zeros(1))
    before = marked(here).sum()
    here.studio.person.paint(dab)
    assert marked(here).sum() > before
