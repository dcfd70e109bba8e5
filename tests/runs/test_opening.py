import itertools

import pytest

from frida_painter.runs.opening import replan_policy, wanted_ground
from frida_painter.runs.spec import RunSpec
from frida_painter.session.replan_policy import EvenlySpaced, EveryNth, looks_on_the_way


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
        ("white", {"goal": [{"sketch": "pear.png"}, {"style": "waves.jpg"}]}),
        ("white", {"initial": [{"text": "a lemon"}]}),
    ],
)
def test_pictures_are_painted_on_a_toned_ground_where_nobody_has_to_tone_it(
    ground: str, values: dict[str, object]
) -> None:
    assert wanted_ground(RunSpec.of(**{"goal": [{"image": "boat.png"}], **values})) == ground
