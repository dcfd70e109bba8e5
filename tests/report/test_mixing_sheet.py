from collections.abc import Callable
from dataclasses import replace

import pytest
import torch

from frida_painter.mixing import Finish
from frida_painter.mixing.paint import find_acrylic, usual_paints
from frida_painter.mixing.recipe import PaintSet
from frida_painter.mixing.shopping import BrushPaints, Mixture, supplies
from frida_painter.report.sheets import mixing_sheet, shopping_list, shopping_sheet
from frida_painter.strokes.palette import from_hex
from frida_painter.system.sheet import A4
from snapshots import shrunk

COLORS = torch.stack([from_hex(text) for text in ("#e9dccb", "#c9a27e", "#7d9a57", "#3a5f8a", "#802828", "#101010")])


@pytest.fixture(scope="module")
def found() -> tuple[BrushPaints, ...]:
    """Two brushes; the second takes up one of the first one's paints."""
    recipes = PaintSet(usual_paints(), Finish.matte, darkest=None).mix(COLORS)
    wells = [((1, 1), (2, 4)), ((1, 2),), ((1, 3),), ((2, 1),), ((2, 2),), ((2, 3),)]
    volumes = (8.0, 6.5, 0.4, 0.3, 0.3, 11.0)
    mixtures = [Mixture(*told) for told in zip(recipes, wells, volumes, strict=True)]
    return (
        BrushPaints("Layer 1: broad brush, 80 strokes", tuple(mixtures[:3])),
        BrushPaints("Layer 2: fine brush, 1 stroke", tuple(mixtures[3:]), "Mixed before: well 4 (layer 1, well 1)"),
    )


def test_the_sheet_looks_as_it_was_found_good(found: tuple, snapshot: Callable[..., None]) -> None:
    snapshot("mixing-sheet", shrunk(mixing_sheet(found, "Mixing"), 900))


def test_the_shopping_list_looks_as_it_was_found_good(found: tuple, snapshot: Callable[..., None]) -> None:
    snapshot("shopping-sheet", shrunk(shopping_sheet(found, "6 paints for 81 strokes"), 900))


def test_the_text_names_every_tube_and_every_colour_out_of_reach(found: tuple) -> None:
    text = shopping_list(found)
    for supply in supplies(found):
        assert f"{supply.in_tubes} " in text and supply.paint.title in text
    missed = [mixture for brush in found for mixture in brush.mixtures if not mixture.recipe.within_reach]
    assert text.count("cannot be mixed") == len(missed)


def test_the_colours_wanted_stand_beside_those_predicted(found: tuple) -> None:
    sheet = mixing_sheet(found, "Mixing").permute(1, 2, 0).reshape(-1, 3)
    for recipe in (mixture.recipe for brush in found for mixture in brush.mixtures):
        for color in (recipe.target, recipe.color):
            assert int(((sheet - color).abs().amax(1) < 0.004).sum()) > 2500


def test_a_long_palette_makes_a_long_page_and_many_tubes_a_wide_one(found: tuple) -> None:
    assert mixing_sheet(found * 8, "Mixing").shape[1] > 1754
    assert mixing_sheet(found[:1], "Mixing").shape[1:] == (1754, A4[0])
    many = [replace(find_acrylic("carbon black"), name=f"my own paint {number}") for number in range(24)]
    recipe = replace(found[0].mixtures[0].recipe, parts=tuple((paint, 1) for paint in many))
    assert mixing_sheet((BrushPaints("", (Mixture(recipe, ((1, 1),)),)),), "Mixing").shape[2] > A4[0]
