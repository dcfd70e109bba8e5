import itertools

import numpy as np
import pytest
from numpy.typing import NDArray

from frida_painter.runs.settle import replan_policy
from frida_painter.runs.spec import RunSpec
from frida_painter.session.replan_policy import EvenlySpaced, EveryNth, looks_on_the_way
from frida_painter.virtual.paint import BANDS, absorption_and_scattering, film_over, to_srgb

TRUE_PHOTOGRAPHS = True


@pytest.mark.parametrize(
    ("replans", "layers", "looks"),
    [
        (4, (200,), [10, 57, 105, 152]),
        (4, (120, 80), [10, 65, 120, 160]),
        (3, (120, 40, 40), [10, 120, 160]),
        (2, (120, 40, 40), [120, 160]),
        (1, (120, 80), [120]),
        (0, (120, 80), []),
        (9, (3, 2), [1, 2, 3, 4]),
    ],
)
def test_looks_where_a_layer_begins_are_among_those_that_were_asked_for(
    replans: int, layers: tuple[int, ...], looks: list[int]
) -> None:
    policy = replan_policy(RunSpec.of(replans=replans), layers)
    assert isinstance(policy, EvenlySpaced) and looks_on_the_way(policy, sum(layers)) == looks
    assert all(one < other for one, other in itertools.pairwise(looks))


def test_a_policy_that_is_named_is_the_policy() -> None:
    assert replan_policy(RunSpec.of(replan_policy="every:7"), (120, 80)) == EveryNth(7)


@pytest.mark.parametrize(
    ("ground", "values"),
    [
        ("auto", {}),
        ("white", {"ground": "white"}),
        ("#c8a878", {"ground": "#c8a878"}),
        ("white", {"strokes": 99}),
        ("white", {"robot": "human"}),
        ("white", {"studio_canvas": "old.png"}),
        ("scene", {"goal": [{"text": "a lemon"}]}),
        ("scene", {"goal": [{"sketch": "pear.png"}, {"text": "a pear"}, {"style": "waves.jpg"}]}),
        ("scene", {"goal": [{"sketch": "pear.png"}, {"style": "waves.jpg"}]}),
        ("white", {"initial": [{"text": "a lemon"}]}),
        ("auto", {"goal": [{"semantic": "boat.png"}]}),
        ("scene", {"goal": [{"style": "waves.jpg"}]}),
        ("scene", {"goal": [{"image": "boat.png"}, {"style": "waves.jpg"}], "strokes": 60}),
        ("scene", {"goal": [{"text": "a lemon"}, {"style": "waves.jpg"}], "initial": [{"style": "waves.jpg"}]}),
    ],
)
def test_pictures_are_painted_on_a_toned_ground_where_nobody_has_to_tone_it(
    ground: str, values: dict[str, object]
) -> None:
    assert RunSpec.of(**{"goal": [{"image": "boat.png"}], **values}).wanted_ground == ground


def test_the_studio_knows_its_darkest_paint_and_others_are_told() -> None:
    assert RunSpec.of(robot="human").darkest_paint is None
    assert RunSpec.of(robot="human", darkest="#332211").darkest_paint == (51 / 255, 34 / 255, 17 / 255)
    assert RunSpec.of(darkest="#000000").darkest_paint == (0, 0, 0)
    of_studio = RunSpec.of().darkest_paint
    black = film(absorption_and_scattering(np.zeros(3)))
    assert of_studio == pytest.approx(tuple(to_srgb(black)), abs=0.002)


def film(paint: NDArray[np.float64]) -> NDArray[np.float64]:
    """What a film of paint, a millimetre thick, reflects over white, three bands."""
    return np.array([film_over(paint[band], paint[BANDS + band], 1.0, 1.0) for band in range(BANDS)])
