from dataclasses import replace
from pathlib import Path

import pytest
import torch

from frida_painter.errors import StorageError
from frida_painter.mixing.paint import usual_paints
from frida_painter.mixing.recipe import PaintSet
from frida_painter.report.sheets import RecipeSheets
from frida_painter.strokes.palette import Palette
from support.plans import made_up_plan

PLAN = made_up_plan(6, 3)


def test_sheets_and_recipes_are_there_when_it_has_finished(tmp_path: Path) -> None:
    sheets = RecipeSheets(tmp_path)
    sheets.renew(PLAN)
    found, left_out = sheets.finish()
    names = {path.name for path in tmp_path.iterdir()}
    assert names == {"palette.png", "mixing.png", "shopping.png", "shopping.txt"} and left_out == 0
    plain = PaintSet(usual_paints()).mix(PLAN.palette.color)
    assert [mixture.recipe.words for brush in found for mixture in brush.mixtures] == [one.words for one in plain]
    assert sheets.finish() == (found, 0), "finishing again changes nothing"


def test_sheets_are_made_again_only_where_the_paints_are_new(tmp_path: Path) -> None:
    plan = PLAN.under(made_up_plan(6, 3, seed=5))
    (upper,) = plan.part(slice(6, None)).filled_layers()
    paints = Palette(upper.palette.color * 0.9)
    strokes = upper.strokes.with_groups(color=paints.color[upper.paint])
    mixed = plan.part(slice(6)).followed_by(
        plan.part(slice(6, None)).with_parts([replace(upper, palette=paints, strokes=strokes)])
    )
    files = [tmp_path / f"{name}.png" for name in ("palette", "palette-layer-2", "mixing")]
    sheets = RecipeSheets(tmp_path)
    sheets.renew(plan)
    sheets.finish()
    before = [file.read_bytes() for file in files]
    files[0].write_bytes(b"as it hangs beside the easel")
    sheets = RecipeSheets(tmp_path)
    sheets.renew(mixed, before=plan.palette)
    found, _ = sheets.finish()
    assert [len(brush.mixtures) for brush in found] == [3, 3]
    assert files[0].read_bytes() == b"as it hangs beside the easel"
    assert all(file.read_bytes() != old for file, old in zip(files[1:], before[1:], strict=True))


def test_where_there_is_no_room_it_is_counted_and_what_is_wrong_otherwise_is_raised(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    troubles = [StorageError("full"), None, ValueError("wrong")]

    def save(picture: torch.Tensor, path: Path) -> None:
        trouble = troubles.pop(0)
        if trouble is not None:
            raise trouble

    monkeypatch.setattr("frida_painter.report.sheets.images.save", save)
    sheets = RecipeSheets(tmp_path)
    sheets.renew(PLAN)
    sheets.renew(PLAN)
    with pytest.raises(ValueError, match="wrong"):
        sheets.finish()
    troubles[:] = [StorageError("full")]
    sheets = RecipeSheets(tmp_path)
    sheets.renew(PLAN)
    assert sheets.finish()[1] == 1
