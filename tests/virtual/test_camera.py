import cv2
import numpy as np
import pytest

from frida_painter.errors import CameraError, StaleFrame
from frida_painter.virtual import camera
from frida_painter.virtual.camera import CameraSpec
from frida_painter.virtual.paint import to_linear, to_srgb

from .hand import Hand

SMALL = CameraSpec(photograph=(480, 640))


def rectified(hand, image, rows=180):
    """The canvas as a picture, through the calibration's corners alone."""
    columns = round(rows * hand.easel.canvas.width / hand.easel.canvas.height)
    target = np.array([(-0.5, -0.5), (columns - 0.5, -0.5), (columns - 0.5, rows - 0.5), (-0.5, rows - 0.5)])
    corners = np.array(hand.easel.calibration.corners)
    view = cv2.getPerspectiveTransform(corners.astype(np.float32), target.astype(np.float32))
    return cv2.warpPerspective(image, view, (columns, rows), flags=cv2.INTER_LINEAR)


def test_a_photograph_is_newer_than_the_motion_before_it_and_numbered():
    hand = Hand([0.1, 0.1, 0.1], camera=SMALL)
    frames = []
    for _ in range(3):
        report = hand.easel.robot.home()
        frames.append(hand.easel.camera.capture(report.finished_at))
        assert frames[-1].captured_at > report.finished_at
    assert [frame.sequence for frame in frames] == [0, 1, 2]
    assert frames[0].image.shape == (480, 640, 3)
    assert frames[0].image.dtype == np.uint8
    assert hand.easel.calibration.photograph == (480, 640)
    with pytest.raises(StaleFrame, match="later than"):
        hand.easel.camera.capture(1e6)
    hand.easel.camera.close()
    with pytest.raises(CameraError, match="connect"):
        hand.easel.camera.capture(0.0)


@pytest.mark.parametrize("spec", [SMALL, CameraSpec.ideal(480, 640)])
def test_an_asymmetric_mark_appears_in_the_photograph_where_and_as_the_frames_say(spec):
    hand = Hand([0.1, 0.1, 0.1], brush="fine", camera=spec)
    # An L: a long upright at x = 30 mm, a short foot to the right of its lower end.
    for x, y, length, angle in ((0.03, 0.075, 0.05, -np.pi / 2), (0.03, 0.022, 0.03, 0.0)):
        hand.dip(0)
        hand.stroke(x, y, length, angle=angle)
    hand.easel.robot.home()
    seen = rectified(hand, hand.easel.camera.capture(hand.studio.clock.now).image) / 255
    truth = hand.studio.truth(180).permute(1, 2, 0).numpy()

    def dark(image, x, y):
        return image[round(180 - y * 2000), round(x * 2000)].mean() < 0.4

    for image in (seen, truth):
        assert dark(image, 0.030, 0.06)
        assert dark(image, 0.050, 0.022)
        assert not dark(image, 0.09, 0.06)  # Mirrored left to right.
        assert not dark(image, 0.050, 0.068)  # Mirrored top to bottom.
        assert not dark(image, 0.010, 0.022)
    marks, drawn = (np.argwhere(image.mean(2) < 0.5).mean(0) for image in (seen, truth))
    assert np.abs(marks - drawn).max() < 1.5


def test_light_is_uneven_and_coloured_and_dividing_by_the_blank_canvas_corrects_most_of_it():
    hand = Hand([0.75, 0.3, 0.2], brush="broad", camera=SMALL)
    hand.easel.robot.home()
    blank = rectified(hand, hand.easel.camera.capture(0.0).image) / 255
    assert np.ptp(cv2.GaussianBlur(blank, (0, 0), 5)[10:-10, 10:-10, 1]) > 0.02
    assert blank[..., 0].mean() - blank[..., 2].mean() > 0.02
    for x in (0.02, 0.06):
        hand.dip(0)
        hand.stroke(x, 0.045, 0.04)
    hand.easel.robot.home()
    image = rectified(hand, hand.easel.camera.capture(0.0).image) / 255
    truth = hand.studio.truth(180).permute(1, 2, 0).numpy()
    corrected = to_srgb(to_linear(image) / to_linear(cv2.GaussianBlur(blank, (0, 0), 6)))
    body = np.s_[82:98, 60:100]
    raw_error, error = (np.abs((picture - truth)[body].mean((0, 1))).max() for picture in (image, corrected))
    assert error < 0.04
    assert np.abs(corrected - truth)[10:-10, 10:-10].mean() < 0.4 * np.abs(image - truth)[10:-10, 10:-10].mean()
    assert raw_error > 0.02


def test_the_arm_hides_the_canvas_until_it_is_sent_home():
    hand = Hand([0.9, 0.9, 0.2], camera=SMALL)
    hand.easel.robot.home()
    bare = hand.easel.camera.capture(0.0).image.astype(int)
    hand.follow("above", hand.easel.workspace.to_robot(np.array([[0.06, 0.045]]), np.array([0.13])))
    with_arm = hand.easel.camera.capture(0.0).image.astype(int)
    hand.easel.robot.home()
    again = hand.easel.camera.capture(0.0).image.astype(int)
    assert (np.abs(with_arm - bare).mean(2) > 60).mean() > 0.02
    assert (np.abs(again - bare).mean(2) > 60).mean() == 0


def laid(looks, shape, view, to_cell, scene):
    """What `_lay` is to do, written down plainly: every product and sum in the same order and precision."""
    high, wide = looks.shape[:2]
    x, y = (row[0] * view[..., 0] + row[1] * view[..., 1] + row[2] for row in to_cell)  # float32
    inside = (x >= -0.5) & (x <= shape[1] - 0.5) & (y >= -0.5) & (y <= shape[0] - 0.5)
    x = np.minimum(np.maximum(x[inside].astype(np.float64), 0.0), wide - 1.0)
    y = np.minimum(np.maximum(y[inside].astype(np.float64), 0.0), high - 1.0)
    left, above = np.minimum(x.astype(int), wide - 2), np.minimum(y.astype(int), high - 2)
    u, v = x - left, y - above
    corners = [((1 - u) * (1 - v), 0, 0), (u * (1 - v), 0, 1), ((1 - u) * v, 1, 0), (u * v, 1, 1)]
    p, q, s, t = (share[:, None] * looks[above + down, left + right] for share, down, right in corners)
    scene[inside] = p + q + s + t
    return scene


@pytest.mark.parametrize("shape", [(30.0, 40.0), (29.4, 39.7)])
def test_what_lies_flat_comes_into_the_picture_bit_for_bit_as_written_down_plainly(shape):
    random = np.random.default_rng(0)
    looks = random.uniform(0, 1, (30, 40, 3)).astype(np.float32)
    down, across = np.meshgrid(np.linspace(-3, 34, 211), np.linspace(-3, 45, 307), indexing="ij")
    view = np.stack((across, down), -1).astype(np.float32)
    to_cell = np.array([[0.996, 0.02, -0.31], [-0.02, 0.996, 0.17]], np.float32)
    scene = np.full((*view.shape[:2], 3), 0.25, np.float32)
    wanted = laid(looks, shape, view, to_cell, scene.copy())
    camera._lay(looks, shape, view, to_cell, scene)
    assert np.array_equal(scene, wanted)
    assert 0.2 < (wanted == 0.25).all(-1).mean() < 0.8, "there is canvas, and something around it"
