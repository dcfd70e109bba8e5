"""A painting begins on a bare canvas, on a toned one, on an old painting: what the light does is known on all."""

from dataclasses import replace
from pathlib import Path

import pytest
import torch
from torch import Tensor

from frida_painter.calibration import BareCanvas, Calibration
from frida_painter.canvas_size import CanvasSize
from frida_painter.easel.dialogue import lead
from frida_painter.errors import CalibrationError, ConfigError, FrameRejected
from frida_painter.hardware.easel import Easel
from frida_painter.hardware.faults import Faults, LightChange
from frida_painter.perception.flatfield import bare_canvas, is_evenly, light_by_margin
from frida_painter.session.observer import CanvasObserver, CanvasStart
from frida_painter.strokes.plan import WHITE
from frida_painter.system import images
from frida_painter.virtual.camera import CameraSpec
from frida_painter.virtual.studio import StudioSettings, VirtualStudio, open_studio
from frida_painter_calibration.procedures.canvas import canvas as canvas_procedure

SIZE, ROWS = CanvasSize(0.20, 0.15), 150
CAMERA = CameraSpec((600, 800))
TAN = (0.784, 0.659, 0.471)


def studio(**settings: object) -> VirtualStudio:
    opened = open_studio(SIZE, seed=5, settings=StudioSettings(camera=CAMERA, **settings))  # type: ignore[arg-type]
    opened.easel.robot.connect()
    opened.easel.camera.connect()
    return opened


def old_painting() -> Tensor:
    """A picture [3, 150, 200] of dark and light, and of colours, up to its edges."""
    down, across = torch.meshgrid(torch.linspace(0, 1, 150), torch.linspace(0, 1, 200), indexing="ij")
    smooth = torch.stack((0.2 + 0.6 * across, 0.9 - 0.7 * down, 0.3 + 0.4 * (across - 0.5).abs()))
    return torch.where(((8 * across).long() + (6 * down).long()) % 2 == 0, smooth, 1 - 0.8 * smooth)


@pytest.fixture(scope="module")
def bare() -> BareCanvas:
    seen = studio().easel
    return bare_canvas(seen.camera.capture(0.0).image, seen.calibration, SIZE)


@pytest.fixture
def painted(tmp_path: Path) -> VirtualStudio:
    images.save(old_painting(), tmp_path / "old.png")
    return studio(picture=tmp_path / "old.png")


def known(easel: Easel, bare: BareCanvas) -> Easel:
    return replace(easel, calibration=replace(easel.calibration, bare=bare))


def error(opened: VirtualStudio, seen: Tensor) -> float:
    return float((seen - opened.truth(ROWS)).square().mean().sqrt())


def test_the_studio_shows_what_is_on_its_canvas(painted: VirtualStudio) -> None:
    assert float((painted.truth(150) - old_painting()).abs().mean()) < 0.01


def test_an_old_painting_is_seen_in_its_true_colors_by_the_margin(painted: VirtualStudio, bare: BareCanvas) -> None:
    observer = CanvasObserver(known(painted.easel, bare), CanvasStart(on_canvas=True))
    seen = observer.look(0.0, ROWS)
    assert error(painted, seen) < 0.05
    unaware = CanvasObserver(painted.easel)
    with pytest.raises(FrameRejected, match=r"does not look bare.* say --on-canvas"):
        unaware.look(0.0, ROWS)


def test_a_lamp_that_moved_since_the_canvas_was_bare_is_accounted_for(painted: VirtualStudio, bare: BareCanvas) -> None:
    observer = CanvasObserver(known(painted.easel, bare), CanvasStart(on_canvas=True))
    before = error(painted, observer.look(0.0, ROWS))
    change = LightChange(0, gain=(0.75, 0.7, 0.6), lean=(0.1, -0.08))
    painted.break_things(Faults(light_changes=(change,)))
    later = CanvasObserver(known(painted.easel, bare), CanvasStart(on_canvas=True))
    after = error(painted, later.look(0.0, ROWS))
    later.light = observer.light  # as if nothing had changed
    unaware = error(painted, later.look(0.0, ROWS))
    assert after < before + 0.015 and unaware > 2 * after


@pytest.mark.parametrize("answer", [True, False])
def test_what_is_on_the_canvas_is_noticed_and_asked_about(bare: BareCanvas, answer: bool) -> None:
    toned = studio(ground=TAN)
    asked: list[str] = []

    def paint_on(sentence: str, canvas: Tensor) -> bool:
        asked.append(sentence)
        assert float((canvas.mean((1, 2)) - torch.tensor(TAN)).abs().max()) < 0.05
        return answer

    observer = CanvasObserver(known(toned.easel, bare), CanvasStart(paint_on=paint_on))
    if answer:
        assert error(toned, observer.look(0.0, ROWS)) < 0.04
    else:
        with pytest.raises(ConfigError, match=r"not bare: 100 %.* say --on-canvas"):
            observer.look(0.0, ROWS)
    assert len(asked) == 1


def test_a_canvas_that_has_the_ground_already_is_not_asked_about(bare: BareCanvas) -> None:
    toned = studio(ground=TAN)
    nearly = (TAN[0] - 0.05, TAN[1] + 0.03, TAN[2])
    observer = CanvasObserver(known(toned.easel, bare), CanvasStart(nearly))
    assert error(toned, observer.look(0.0, ROWS)) < 0.04


def test_a_bare_canvas_teaches_the_light_as_before(bare: BareCanvas) -> None:
    plain, aware = studio(), studio()
    one = CanvasObserver(plain.easel).look(0.0, ROWS)
    other = CanvasObserver(known(aware.easel, bare)).look(0.0, ROWS)
    assert torch.equal(one, other) and is_evenly(one, WHITE)
    with pytest.raises(ConfigError, match="the canvas is bare; leave it out"):
        CanvasObserver(known(studio().easel, bare), CanvasStart(on_canvas=True)).look(0.0, ROWS)


def test_without_a_bare_canvas_nothing_is_known_of_the_light(painted: VirtualStudio) -> None:
    with pytest.raises(CalibrationError, match="put up a bare white canvas once"):
        CanvasObserver(painted.easel, CanvasStart(on_canvas=True)).look(0.0, ROWS)


def test_other_surroundings_are_not_believed(painted: VirtualStudio, bare: BareCanvas) -> None:
    photograph = painted.easel.camera.capture(0.0).image.copy()
    record = replace(painted.easel.calibration, bare=bare)
    light_by_margin(photograph, record, SIZE)
    photograph[::2] //= 3
    photograph[:, ::3] //= 4
    photograph[: photograph.shape[0] // 2, : photograph.shape[1] // 2] //= 2
    with pytest.raises(FrameRejected, match=r"surroundings of the canvas differ|places around the canvas"):
        light_by_margin(photograph, record, SIZE)


def test_the_canvas_calibration_keeps_a_bare_canvas_and_no_other(painted: VirtualStudio, tmp_path: Path) -> None:
    opened = studio()
    found = lead(canvas_procedure(opened.easel), lambda question: question.proposal)
    record = found.enter(opened.easel.calibration)
    assert record.bare is not None and "It is bare" in found.sentence
    record.save(tmp_path / "record.json")
    assert Calibration.load(tmp_path / "record.json").bare == record.bare
    corners = painted.easel.calibration.corners
    pointed = lead(canvas_procedure(painted.easel), lambda question: corners)
    assert pointed.enter(painted.easel.calibration).bare is None and "not bare" in pointed.sentence


@pytest.mark.parametrize("light", [((0.0,) * 15,) * 2, ((float("nan"),) * 15,) * 3, ((0.0,) * 14,) * 3])
def test_a_record_that_cannot_be_true_is_refused(light: tuple[tuple[float, ...], ...]) -> None:
    with pytest.raises(CalibrationError, match="bare canvas cannot be true"):
        BareCanvas(light, ((0.1, 0.1, 0.1),))
