from collections.abc import Iterator

import pytest

from frida_painter.hardware.faults import Faults
from frida_painter.session.events import Event, StrokePainted
from frida_painter.system import images
from frida_painter.virtual.studio import StudioSettings
from support.coffee import OFF, coffee, error, error_with_looks, paint_coffee
from support.small_world import small_world


@pytest.fixture(scope="module", autouse=True)
def _small_photographs() -> Iterator[None]:
    with small_world((360, 480)):
        yield


def test_looking_beats_painting_blindly_where_the_robot_stands_off() -> None:
    """Measured: 0.67. tests/stress/claims.py paints more strokes, with more seeds."""
    assert error_with_looks(0, replans=3, strokes=40, effort=0.1) < 0.8


def test_a_painting_from_end_to_end_shows_what_was_wanted_and_survives_faults() -> None:
    """30 strokes, of which one does not touch the canvas, while one photograph is stale."""
    numbers: list[int] = []

    def hear(event: Event) -> None:
        if isinstance(event, StrokePainted):
            numbers.append(event.done)

    faults = Faults(dropped_touches=frozenset({5}), stale_photographs=frozenset({2}))
    settings = StudioSettings(placement_error=OFF, faults=faults)
    painting, studio, planner = paint_coffee(0, 2, strokes=30, effort=0.1, settings=settings, notify=hear)
    assert numbers == list(range(1, 31)) and painting.painted == 30
    assert painting.rest is not None and len(painting.rest) == 0
    bare = float((1 - images.fit(coffee(), planner.fine.rows, planner.fine.columns)).square().mean())
    assert error(studio, planner) < 0.25 * bare
    assert planner.validation_loss(painting.photograph) == pytest.approx(error(studio, planner), rel=0.15)
