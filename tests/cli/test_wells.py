import json
from collections.abc import Callable
from pathlib import Path

import pytest
import torch

from frida_painter.errors import ConfigError, FrameRejected, Interrupted
from frida_painter.perception.color import read_palette
from frida_painter.strokes.palette import Palette, from_hex
from frida_painter.system import images
from frida_painter_cli.options import Wells
from support.plans import made_up_plan

WANTED = Palette(torch.tensor([[0.9, 0.9, 0.8], [0.3, 0.2, 0.2]]))
MIXED = ["#ddddcc", "#553333"]


def palette_file(folder: Path, paints: list[str] = MIXED) -> Path:
    path = folder / "mixed.json"
    path.write_text(json.dumps({"paints": paints}))
    return path


def photograph(folder: Path) -> Path:
    fields = torch.stack([from_hex(text) for text in ("#f0f0f0", *MIXED)])
    path = folder / "strip.png"
    strip = fields.T[:, None, :].expand(3, 40, -1).repeat_interleave(40, 2)
    images.save(strip - 0.05 * torch.rand(3, 40, 120, generator=torch.Generator().manual_seed(0)), path)
    return path


def typing(*lines: str | type[BaseException]) -> tuple[Callable[[str], str], list[str]]:
    waiting, prompts = list(lines), []

    def ask(prompt: str) -> str:
        prompts.append(prompt)
        line = waiting.pop(0)
        if not isinstance(line, str):
            raise line
        return line

    return ask, prompts


def test_what_was_mixed_is_read_from_a_file_or_a_photograph(tmp_path: Path) -> None:
    written = read_palette(palette_file(tmp_path), None)
    seen = read_palette(photograph(tmp_path), 2)
    assert torch.allclose(written.color, torch.stack([from_hex(text) for text in MIXED]))
    assert torch.allclose(seen.color, written.color, atol=0.06)


def test_palettes_that_do_not_fit_are_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="has 2 paints, and 3 are wanted"):
        read_palette(palette_file(tmp_path), 3)
    with pytest.raises(ConfigError, match="say it with --colors"):
        read_palette(photograph(tmp_path), None)
    with pytest.raises(FrameRejected, match="even colour"):
        read_palette(photograph(tmp_path), 1)
    with pytest.raises(ConfigError, match="does not exist"):
        read_palette(tmp_path / "nowhere.json", 2)
    with pytest.raises(ConfigError, match="does not exist"):
        read_palette(tmp_path / "nowhere.png", 2)


def test_nobody_is_asked_where_nobody_is_to_be(tmp_path: Path) -> None:
    assert Wells(None, None, tmp_path).fill(WANTED) is None
    assert Wells(WANTED, None, tmp_path).fill(WANTED) is WANTED


def test_a_person_is_shown_the_sheets_and_waited_for(tmp_path: Path) -> None:
    ask, prompts = typing("go")
    assert Wells(None, ask, tmp_path).fill(WANTED) is None
    assert "Fill 2 wells" in prompts[0] and str(tmp_path / "palette.png") in prompts[0]


def test_a_later_layer_is_asked_for_by_its_own_sheet(tmp_path: Path) -> None:
    first, more = made_up_plan(6, 2), made_up_plan(4, 3, seed=1)
    plan = first.under(more).under(made_up_plan(3, 2, seed=2))
    plan.save(tmp_path / "plan.json")
    for name in ("palette.png", "palette-layer-2.png", "palette-layer-3.png"):  # all of them are made at once
        (tmp_path / name).touch()
    for layer, sheet in zip(plan.layers, ("palette.png", "palette-layer-2.png", "palette-layer-3.png"), strict=True):
        ask, prompts = typing("", "go")
        assert Wells(None, ask, tmp_path).fill(plan.wells(layer)) is None
        assert str(tmp_path / sheet) in prompts[0] and "mixing.png" in prompts[0]


def test_who_has_said_that_the_wells_are_filled_is_only_asked_for_what_was_mixed(tmp_path: Path) -> None:
    ask, prompts = typing("go")
    assert Wells(WANTED, ask, tmp_path, poured=True).fill(WANTED) is WANTED
    assert "Fill" not in prompts[0] and "what you mixed" in prompts[0]


def test_a_person_may_tell_what_was_mixed_and_is_asked_again_where_that_cannot_be(tmp_path: Path) -> None:
    ask, prompts = typing("nowhere.json", str(palette_file(tmp_path, ["#000000"])), str(photograph(tmp_path)))
    mixed = Wells(None, ask, tmp_path).fill(WANTED)
    assert mixed is not None and len(mixed) == 2
    assert "does not exist" in prompts[1] and "has 1 paints, and 2 are wanted" in prompts[2]


@pytest.mark.parametrize("leaving", [EOFError, KeyboardInterrupt])
def test_who_leaves_paints_nothing(tmp_path: Path, leaving: type[BaseException]) -> None:
    with pytest.raises(Interrupted, match="nothing was painted"):
        Wells(None, typing(leaving)[0], tmp_path).fill(WANTED)
