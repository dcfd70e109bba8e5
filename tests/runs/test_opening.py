import pytest

from frida_painter.runs.opening import replan_policy
from frida_painter.runs.spec import RunSpec
from frida_painter.session.replan_policy import EvenlySpaced, EveryNth


@pytest.mark.parametrize(
    ("replans", "layers", "inside"), [(4, 1, 4), (4, 2, 3), (4, 3, 2), (1, 2, 1), (2, 8, 1), (0, 2, 0)]
)
def test_looks_where_a_layer_begins_are_among_those_that_were_asked_for(replans: int, layers: int, inside: int) -> None:
    assert replan_policy(RunSpec.of(replans=replans), layers) == EvenlySpaced(inside)


def test_a_policy_that_is_named_is_the_policy() -> None:
    assert replan_policy(RunSpec.of(replan_policy="every:7"), 2) == EveryNth(7)
