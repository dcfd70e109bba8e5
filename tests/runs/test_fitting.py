"""Canvas and pictures of different proportions."""

from pathlib import Path

import pytest
import torch

from frida_painter.errors import ConfigError
from frida_painter.objectives.objective import Goal
from frida_painter.runs.goals import make_goal
from frida_painter.runs.settle import fit_canvas
from frida_painter.runs.spec import RunSpec
from frida_painter.system import images

TRUE_PHOTOGRAPHS = True


@pytest.fixture
def square(tmp_path: Path) -> Goal:
    """A square photograph, black above and white below."""
    picture = torch.zeros(3, 60, 60)
    picture[:, 30:] = 1
    images.save(picture, tmp_path / "square.png")
    return make_goal(tmp_path / "square.png")


def test_by_default_the_canvas_takes_the_pictures_proportions_within_its_size(square: Goal) -> None:
    made = fit_canvas(RunSpec.of(canvas="300x200mm"), square)
    assert str(made.spec.canvas) == "200 x 200 mm" and made.remark == ""
    assert made.target is not None and made.target.shape == (3, 864, 864)
    assert made.spec.as_kept == made.spec, "a folder keeps it to the last digit"


def test_a_crop_says_how_much_is_left_out(square: Goal) -> None:
    made = fit_canvas(RunSpec.of(canvas="300x200mm", fit="crop"), square)
    assert str(made.spec.canvas) == "300 x 200 mm"
    assert "33 % of its height is left out" in made.remark and "--fit pad" in made.remark
    assert "50 % of its width is left out" in fit_canvas(RunSpec.of(canvas="100x200mm", fit="crop"), square).remark
    assert fit_canvas(RunSpec.of(canvas="200x200mm", fit="crop"), square).remark == ""


def test_padding_shows_the_whole_picture_on_white(square: Goal) -> None:
    made = fit_canvas(RunSpec.of(canvas="300x200mm", fit="pad"), square)
    assert made.target is not None and made.remark == ""
    middle = made.target[:, :, 300:1000]
    assert float(made.target[:, :, :200].min()) == 1 and float(middle[:, :400].max()) == 0


@pytest.mark.parametrize("side", [60, 700, 1280, 1500])
def test_what_is_planned_towards_is_not_softened_on_the_way(side: int, tmp_path: Path) -> None:
    """At the planner's resolution it has the means of the file's areas, whatever its size."""
    chance = torch.Generator().manual_seed(3)
    images.save(torch.rand(3, side, side, generator=chance), tmp_path / "noise.png")
    (term,) = fit_canvas(RunSpec.of(), make_goal(tmp_path / "noise.png")).goal.terms
    assert term.picture is not None and term.picture.shape[1] <= 1024
    of_file = images.resize_by_area(images.load(tmp_path / "noise.png"), 256, 256)
    assert float((images.resize_by_area(term.picture, 256, 256) - of_file).abs().max()) < 1e-4


@pytest.mark.parametrize("settings", [{"robot": "human", "camera": "opencv:0"}, {"calibration": Path("record.json")}])
def test_a_canvas_that_lies_on_an_easel_stays_as_it_is(square: Goal, settings: dict[str, object]) -> None:
    made = fit_canvas(RunSpec.of(canvas="300x200mm", **settings), square)
    assert str(made.spec.canvas) == "300 x 200 mm" and "is left out" in made.remark


def test_a_picture_too_narrow_for_any_canvas_is_refused(tmp_path: Path) -> None:
    images.save(torch.rand(3, 20, 600), tmp_path / "narrow.png")
    with pytest.raises(ConfigError, match=r"The picture is 30 times as wide as high.*--fit crop"):
        fit_canvas(RunSpec.of(), make_goal(tmp_path / "narrow.png"))
