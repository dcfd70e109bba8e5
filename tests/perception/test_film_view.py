from dataclasses import replace

import numpy as np
import pytest

from frida_painter.canvas_size import CanvasSize
from frida_painter.errors import FrameRejected
from frida_painter.frames import PixelGrid
from frida_painter.perception.color import true_color
from frida_painter.perception.flatfield import FlatField
from frida_painter.perception.rectify import rectify
from frida_painter.session.observer import FilmView
from frida_painter.system.images import from_uint8
from frida_painter.virtual.camera import CameraSpec
from frida_painter.virtual.studio import StudioSettings, open_studio

CANVAS = CanvasSize(0.12, 0.09)
PHOTOGRAPH = (240, 320)
COLOR = ((1.05, -0.04, 0.01, 0.002), (-0.02, 0.98, 0.03, 0.0), (0.0, -0.05, 1.1, -0.001))
CAMERAS = {
    "with a lens": CameraSpec(photograph=PHOTOGRAPH),
    "without a lens": CameraSpec(photograph=PHOTOGRAPH, lens=0),
}


def photographed(camera: CameraSpec):
    """The easel's calibration, and photographs of its canvas: bare, and with squares of all colours."""
    settings = StudioSettings(camera=camera)
    easel = (studio := open_studio(CANVAS, "fine", seed=3, settings=settings)).easel
    easel.robot.connect()
    easel.camera.connect()
    bare = easel.camera.capture(0.0).image
    random = np.random.default_rng(0)
    shade = np.kron(random.uniform(0, 1, (30, 40, 3)), np.ones((8, 8, 1)))
    studio.close()
    return easel.calibration, bare, np.rint(shade * bare).astype(np.uint8)


@pytest.mark.parametrize("rows", [54, 90, 216, 400])  # coarser than the photograph, as fine, and finer
@pytest.mark.parametrize("camera", CAMERAS)
def test_a_picture_for_the_film_is_within_2_of_255_of_one_by_which_things_are_decided(camera, rows):
    calibration, bare, painted = photographed(CAMERAS[camera])
    calibration = replace(calibration, color=COLOR)
    grid = PixelGrid.of_height(CANVAS, rows)
    light = FlatField.learn(rectify(bare, calibration, grid), (1.0, 1.0, 1.0))
    view = FilmView(calibration, light, grid)
    for photograph in (bare, painted, 255 - painted):
        wanted = true_color(light.correct(rectify(photograph, calibration, grid)), calibration)
        got = from_uint8(view.picture(photograph))
        assert got.shape == wanted.shape
        assert float((got - wanted).abs().max()) < 2 / 255


def test_it_fits_one_calibration_one_light_and_one_grid_and_refuses_what_rectify_refuses():
    calibration, bare, _ = photographed(CAMERAS["with a lens"])
    grid = PixelGrid.of_height(CANVAS, 54)
    light = FlatField.learn(rectify(bare, calibration, grid), (1.0, 1.0, 1.0))
    view = FilmView(calibration, light, grid)
    assert view.fits(calibration, light, PixelGrid.of_height(CANVAS, 54))
    assert not view.fits(replace(calibration, color=COLOR), light, grid)
    assert not view.fits(calibration, FlatField(light.logarithm), grid)
    assert not view.fits(calibration, light, PixelGrid.of_height(CANVAS, 55))
    with pytest.raises(FrameRejected, match="is dark"):
        view.picture(np.zeros_like(bare))
    with pytest.raises(FrameRejected, match="A photograph of shape"):
        view.picture(bare[:100])
