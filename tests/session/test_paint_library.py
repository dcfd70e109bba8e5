import numpy as np
import pytest

from frida_painter.brush.kinds import BrushKind
from frida_painter.errors import ConfigError
from frida_painter.frames import CanvasSize
from frida_painter.hardware.easel import Easel
from frida_painter.session.paint_library import paint_library
from frida_painter.strokes import StrokeLimits
from frida_painter.virtual.studio import StudioSettings, open_studio
from frida_painter.virtual.table import PlacementError

KIND = BrushKind("fine", StrokeLimits((0.010, 0.030), (-0.010, 0.010)), 0.010)
SHEET = CanvasSize(0.10, 0.07)
EXACT = PlacementError((0.0, 0.0), 0.0)


class Papers:
    """Hands out small sheets, and counts them."""

    def __init__(self, size: CanvasSize = SHEET) -> None:
        self.size = size
        self.given: list[int] = []

    def __call__(self, number: int) -> Easel:
        self.given.append(number)
        easel = open_studio(
            self.size, "fine", seed=number, placement_error=EXACT, settings=StudioSettings(cell=0.3)
        ).easel
        easel.robot.connect()
        easel.camera.connect()
        return easel


@pytest.fixture(scope="module")
def papers() -> Papers:
    return Papers()


@pytest.fixture(scope="module")
def painted(papers):
    progress = []
    library = paint_library(papers, KIND, count=7, seed=4, notify=progress.append)
    return library, progress


def test_each_stroke_is_painted_photographed_and_told(painted, papers):
    library, progress = painted
    assert len(library) == 7
    assert [step.done for step in progress] == list(range(1, 8))
    assert papers.given == list(range(progress[-1].sheet))
    assert progress[-1].sheet > 1


def test_shapes_lie_within_the_brushs_limits(painted):
    library, _ = painted
    assert ((library.length_m >= 0.010) & (library.length_m <= 0.030)).all()
    assert (np.abs(library.bend_m) <= 0.010).all()


def test_marks_are_opaque_lie_along_their_paths_and_leave_the_paper_clean(painted):
    library, _ = painted
    frame = library.frame
    x, y = frame.cell_centers().numpy().transpose(2, 0, 1)
    for mark, length, bend in zip(library.magnitude / 255, library.length_m, library.bend_m, strict=True):
        fraction = np.linspace(0, 1, 60)[:, None, None]
        away = np.hypot(x - fraction * length, y - 3 * fraction * (1 - fraction) * bend).min(0)
        assert mark[away < 0.0008].mean() > 0.75
        assert mark[away > 0.013].mean() < 0.002


def test_a_crop_holds_the_whole_frame_of_the_brush(painted):
    frame, wanted = painted[0].frame, KIND.frame
    assert frame.left <= wanted.left < wanted.right <= frame.right
    assert frame.bottom <= wanted.bottom < wanted.top <= frame.top


def test_a_paper_that_is_too_small_is_refused():
    with pytest.raises(ConfigError, match="no room"):
        paint_library(Papers(CanvasSize(0.04, 0.03)), KIND, count=1)


@pytest.mark.parametrize("count", [0, -1, 10**6])
def test_a_count_out_of_range_is_refused(count):
    with pytest.raises(ConfigError, match=str(count)):
        paint_library(Papers(), KIND, count=count)
