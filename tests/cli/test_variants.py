import shlex
from pathlib import Path

import pytest
import torch

from frida_painter.runs.spec import RunSpec
from frida_painter.runs.variant_settings import VARIANTS, variant_of
from frida_painter.strokes.plan import Plan
from frida_painter.system import images
from support.commandline import run_command


def spec_with(**settings: object) -> RunSpec:
    return RunSpec.of(goal=[{"image": "photo.jpg"}], **settings)


@pytest.fixture(autouse=True)
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def test_each_variant_has_its_settings_and_the_faithful_one_the_usual() -> None:
    varied = {name: variant_of(spec_with(), name) for name in VARIANTS}
    assert varied["faithful"] == spec_with()
    assert varied["loose"].strokes < 300 and varied["loose"].brushes == VARIANTS["loose"]["brushes"]
    assert varied["graphic"].colors == 5 and varied["graphic"].new_paints is False


@pytest.mark.parametrize(
    "settings",
    [{"strokes": 300, "colors": 9}, {"strokes": 3}, {"strokes": 1}, {"layers": 3}, {"brushes": "fine"}, {"seed": 7},
     {"strokes_of": "comma"}, {"minutes": 45}, {"canvas": "2000x2000mm"}, {"colors": 24}, {"robot": "human"}],
)  # fmt: skip
def test_settings_of_the_person_hold_in_all(settings: dict[str, object]) -> None:
    for name in VARIANTS:
        varied = variant_of(spec_with(**settings), name)
        assert {key: getattr(varied, key) for key in settings} == {
            key: getattr(spec_with(**settings), key) for key in settings
        }


def test_a_robot_that_does_not_change_brushes_keeps_its_own() -> None:
    assert variant_of(spec_with(robot="human"), "loose").brush_names == spec_with(robot="human").brush_names
    assert variant_of(spec_with(strokes=50), "graphic").brush_names == ("broad",)


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (("plan", "photo.jpg", "--variants", 0), "0 is not from 1 to 3"),
        (("plan", "photo.jpg", "--variants", 4), "4 is not from 1 to 3"),
    ],
)
def test_what_is_refused(words: tuple[object, ...], says: str, capsys: pytest.CaptureFixture[str]) -> None:
    images.save(torch.rand(3, 20, 30), Path("photo.jpg"))
    assert run_command(*words) == 2
    assert says in " ".join(capsys.readouterr().err.split())


def test_two_are_planned_side_by_side_and_the_printed_command_paints_one(capsys: pytest.CaptureFixture[str]) -> None:
    images.save(torch.rand(3, 24, 36, generator=torch.Generator().manual_seed(0)), Path("photo.png"))
    small = ("--strokes", 4, "--canvas", "12x9cm", "--effort", 0.05, "--render-height", 64)
    assert run_command("plan", "photo.png", *small, "--variants", 2, "--out", "both") == 0
    told = capsys.readouterr().out
    assert Path("both/variants.png").exists() and "4 strokes" in told
    for name in ("1-loose", "2-faithful"):
        assert len(Plan.load(Path("both", name))) == 4 and Path("both", name, "shopping.txt").exists()
    command = shlex.split(told.rpartition("To paint one: ")[2])
    assert command[-2:] == ["--plan", "both/1-loose"]
    assert run_command(*command[1:], "--no-film", "--replans", 0, "--out", "painted") == 0
    assert torch.equal(Plan.load("painted").strokes.position, Plan.load("both/1-loose").strokes.position)
