"""An objective of one's own: what works is taken, and what is wrong is refused with one sentence before planning."""

from collections.abc import Callable
from typing import Any

import pytest
import torch
from torch import Tensor

import frida_painter as fp
from frida_painter.errors import ConfigError
from frida_painter.objectives.objective import Goal, ObjectiveTerm, Term, require_objective
from support.planning import picture

CPU = torch.device("cpu")


def unrest(image: Tensor) -> Tensor:
    return image.diff(dim=1).abs().mean()


def explode(image: Tensor) -> Tensor:
    raise ValueError("no\nsuch thing")


WRONG: list[tuple[Callable[[Tensor], Any], str]] = [
    (lambda image: unrest(image.detach()), r"without a gradient; .* leave out detach"),
    (lambda image: torch.tensor(3.0), "without a gradient"),
    (lambda image: 3.0, "returned 3.0 of type float"),
    (lambda image: None, "of type NoneType"),
    (lambda image: image.mean(0), r"shape \(24, 32\).*take its mean\(\)"),
    (lambda image: image.mean().reshape(1), r"shape \(1,\)"),
    (lambda image: image.mean() * float("nan"), "returned nan"),
    (lambda image: image.sum() * 0 + 3, "whatever the picture is"),
    (lambda image: torch.tensor(2.0, requires_grad=True), "whatever the picture is"),
    (lambda image: image.sum().sqrt() * 0 + (image - image).square().sum().sqrt(), "gradient that is not finite"),
    (explode, r"failed \(ValueError: no such thing\)"),
    (lambda: 0, "failed"),  # type: ignore[misc,list-item]
]


@pytest.mark.parametrize(("function", "says"), WRONG)
def test_a_wrong_objective_is_refused_with_one_sentence(function: Callable[[Tensor], Any], says: str) -> None:
    with pytest.raises(ConfigError, match=says) as refused:
        require_objective(function, "The objective 'x'", 24, 32, CPU)
    assert "\n" not in str(refused.value) and str(refused.value).endswith(".")


def test_right_ones_are_taken() -> None:
    require_objective(unrest, "x", 24, 32, CPU)
    require_objective(lambda image: (image - image.flip(2)).square().mean(), "x", 24, 32, CPU)


def test_a_planner_refuses_it_before_it_plans() -> None:
    goal = fp.make_goal(picture(), objective=lambda image: image.detach().mean())  # type: ignore[attr-defined]
    with pytest.raises(ConfigError, match="without a gradient"):
        fp.make_planner(goal, strokes=5, render_height=64, focus="none")


class Lying(Term):
    weight = 1.0

    def prepare(self, context: Any) -> ObjectiveTerm:
        return unrest  # type: ignore[return-value]


def test_a_term_that_gives_no_objective_is_refused() -> None:
    with pytest.raises(ConfigError, match=r"Lying.prepare returned a function; it returns an ObjectiveTerm"):
        fp.make_planner(Goal((Lying(),)), strokes=5, render_height=64)


def test_weights_are_for_what_is_there() -> None:
    with pytest.raises(ConfigError, match=r"A weight was given to 'style', and this goal is made of image;"):
        fp.make_goal(picture(), weights={"style": 2.0})
    with pytest.raises(ConfigError, match="'objective'"):
        fp.make_goal(picture(), weights={"objective": 2.0})
    goal = fp.make_goal(picture(), objective=[unrest, unrest], weights={"objective": 0.5})
    assert [term.weight for term in goal.terms] == [1.0, 0.5, 0.5]
    with pytest.raises(ConfigError, match="An objective was given as int"):
        fp.make_goal(picture(), objective=[3])  # type: ignore[list-item]


def test_every_kind_is_reached_by_its_name(tmp_path: Any) -> None:
    fp.save_picture(picture(), tmp_path / "a.png")
    goal = fp.make_goal(kinds={"image": [tmp_path / "a.png", picture()]}, weights={"image": 2.0})
    assert [term.weight for term in goal.terms] == [2.0, 2.0]
    with pytest.raises(ConfigError, match="There is no kind of goal called 'mirrr'"):
        fp.make_goal(picture(), kinds={"mirrr": "left-right"})
    with pytest.raises(ConfigError, match="A Tensor was given to text, which takes words"):
        fp.make_goal(kinds={"text": picture()})
