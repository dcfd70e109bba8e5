from dataclasses import replace

import numpy as np
import pytest
import torch

from frida_painter.brush import DEFAULT_MODEL, MODELS
from frida_painter.brush.field import StrokeField
from frida_painter.brush.library import Flaw
from frida_painter.errors import ConfigError, LibraryError
from frida_painter_calibration.teaching.evaluation import OTHER_BRUSH, geometry, learn
from frida_painter_calibration.teaching.param2stroke import Param2Stroke
from marks import SMALL, small_library


def test_the_papers_network_can_be_chosen_and_another_is_the_default():
    kinds = {name: type(learn(name, small_library(6), SMALL, hasty=True).model) for name in MODELS}
    assert kinds == {"field": StrokeField, "param2stroke": Param2Stroke}
    assert kinds[DEFAULT_MODEL] is StrokeField


def test_a_brush_of_the_project_is_learned_on_its_own_frame():
    learned = learn(DEFAULT_MODEL, small_library(6), SMALL, hasty=True)
    assert (learned.model.brush, learned.model.frame, learned.model.limits) == ("small", SMALL.frame, SMALL.limits)


def test_of_another_brush_the_library_says_what_it_can_do():
    library = small_library(20)
    learned = learn(DEFAULT_MODEL, library, hasty=True)
    frame, limits, whole = learned.model.frame, learned.model.limits, library.frame
    assert learned.model.brush == OTHER_BRUSH
    assert (frame.left, frame.right, frame.bottom, frame.top) == (whole.left, whole.right, whole.bottom, whole.top)
    assert frame.pitch[0] == pytest.approx(frame.pitch[1], rel=0.05)
    assert limits.length[0] < library.length_m.min() < library.length_m.max() < limits.length[1]
    assert limits.bend[0] < library.bend_m.min() < library.bend_m.max() < limits.bend[1]


def test_strokes_all_alike_still_give_limits():
    library = small_library(6)
    alike = replace(library, length_m=np.full(6, 1e-5, np.float32), bend_m=np.zeros(6, np.float32))
    _, limits = geometry(alike)
    assert 0 < limits.length[0] < limits.length[1]
    assert limits.bend[0] < 0 < limits.bend[1]


def test_dirty_strokes_are_left_out():
    library = small_library(12)
    flaws = np.zeros(12, np.uint8)
    flaws[[2, 5]] = Flaw.TORN
    learned = learn(DEFAULT_MODEL, replace(library, flaws=flaws), SMALL, hasty=True)
    assert learned.library.recorded_index.tolist() == [i for i in range(12) if i not in (2, 5)]


def test_the_world_is_left_alone():
    before = torch.get_rng_state()
    learn(DEFAULT_MODEL, small_library(5), SMALL, hasty=True)
    assert torch.equal(before, torch.get_rng_state())


def test_what_cannot_be_learned_is_refused():
    with pytest.raises(ConfigError, match="field and param2stroke"):
        learn("vgg", small_library(6))
    with pytest.raises(LibraryError, match="at least 5"):
        learn(DEFAULT_MODEL, small_library(4))
    with pytest.raises(LibraryError, match="start of the stroke"):
        learn(DEFAULT_MODEL, replace(small_library(6), origin_px=(-3.0, 5.0)))
