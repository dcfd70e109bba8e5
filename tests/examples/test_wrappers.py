import gymnasium
import numpy as np
import pytest
import torch
from policies import VectorObservation, VectorObservations

import frida_painter_lab.env  # noqa: F401, registers
from frida_painter.errors import ConfigError

SMALL = {"canvas": "9x7cm", "brush": "fine", "paints": ["#eeddaa", "#222233"], "rows": 28, "strokes": 5}
HALVES = torch.cat((torch.zeros(3, 28, 18), torch.ones(3, 28, 18)), 2)


def test_a_vector_has_the_parts_that_are_promised():
    env = VectorObservation(gymnasium.make("renderer/strokes-v1", goal=HALVES, **SMALL), cells=2)
    vector, _ = env.reset(seed=0)
    assert env.observation_space.contains(vector) and vector.shape == (24 + 6 + 3 + 3,)
    assert vector[:12].reshape(2, 2, 3)[:, 0] == pytest.approx(-1), (
        "black is wanted at the left, and the canvas is white"
    )
    assert vector[:12].reshape(2, 2, 3)[:, 1] == pytest.approx(0) and vector[12:24] == pytest.approx(1)
    assert vector[24:].tolist() == pytest.approx([*np.ravel(env.unwrapped.task.palettes[0]), 1, 0, 0, 0, 1, 1])
    env.step(np.array([0, 0, 0, 0, 0, 0, 1], np.float32))
    after, *_ = env.step(np.array([0, 0, 0, 0, 0, 0, 1], np.float32))
    assert after[30:33].tolist() == [0, 0, 1] and after[-2] == pytest.approx(3 / 5)


def test_vectors_of_several_are_those_of_each():
    several = VectorObservations(gymnasium.make_vec("renderer/strokes-v1", 3, **SMALL), cells=4)
    vectors, _ = several.reset(seed=5)
    assert several.observation_space.contains(vectors)
    alone, _ = VectorObservation(gymnasium.make("renderer/strokes-v1", **SMALL), cells=4).reset(seed=6)
    assert vectors[1] == pytest.approx(alone)


@pytest.mark.parametrize("cells", [0, 65, 29, 2.0, True])
def test_a_wrong_number_of_cells_is_refused(cells):
    with pytest.raises(ConfigError, match="cells"):
        VectorObservation(gymnasium.make("renderer/strokes-v1", **SMALL), cells=cells)


def test_another_environment_is_refused():
    with pytest.raises(ConfigError, match="no canvas and goal"):
        VectorObservation(gymnasium.make("CartPole-v1"))
