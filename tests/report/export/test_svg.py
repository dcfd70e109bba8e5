import re
from dataclasses import replace
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pytest
import svgpathtools
import torch

from frida_painter.errors import PlanError
from frida_painter.report.vector import control_points, svg
from frida_painter.strokes.palette import Palette, to_hex
from frida_painter.strokes.plan import Plan
from frida_painter.strokes.strokes import Strokes
from nightly import installed
from support.plans import CANVAS, LIMITS, in_layers, made_up_plan

SVG = "{http://www.w3.org/2000/svg}"
LABEL = "{http://www.inkscape.org/namespaces/inkscape}label"
MODE = "{http://www.inkscape.org/namespaces/inkscape}groupmode"


def parsed(plan: Plan, **options: Any) -> ElementTree.Element:
    return ElementTree.fromstring(svg(plan, torch.full((len(plan),), 0.006), **options))


def numbers_of_strokes(root: ElementTree.Element) -> list[int]:
    return [int(path.attrib["data-stroke"]) for path in root.iter(f"{SVG}path")]


def test_the_page_is_the_canvas_in_millimetres() -> None:
    root = parsed(made_up_plan())
    assert (root.attrib["width"], root.attrib["height"]) == ("300mm", "200mm")
    assert root.attrib["viewBox"] == "0 0 300 200"


def test_paths_read_back_are_the_strokes_with_y_going_down() -> None:
    plan = made_up_plan()
    paths = list(parsed(plan).iter(f"{SVG}path"))
    assert len(paths) == len(plan)
    for path, points in zip(paths, control_points(plan.strokes), strict=True):
        assert re.fullmatch(r"M-?[\d.]+,-?[\d.]+ C(-?[\d.]+,-?[\d.]+ ?){3}", path.attrib["d"])
        found = torch.tensor([float(number) for number in re.findall(r"-?[\d.]+", path.attrib["d"])]).reshape(4, 2)
        assert torch.allclose(found[:, 0] / 1000, points[:, 0], atol=2e-6)
        assert torch.allclose(CANVAS.height - found[:, 1] / 1000, points[:, 1], atol=2e-6)
        assert path.attrib["stroke-width"] == "6"


def test_a_stroke_at_the_top_of_the_canvas_is_at_the_top_of_the_page() -> None:
    plan = made_up_plan(1, 1)
    top = plan.strokes.with_groups(position=torch.tensor([[0.01, 0.199]]), angle=torch.zeros(1), bend=torch.zeros(1))
    path = next(parsed(replace(plan, strokes=top)).iter(f"{SVG}path"))
    assert path.attrib["d"].startswith("M10.000,1.000 C")


def test_there_is_one_layer_per_paint_in_painting_order() -> None:
    plan = made_up_plan(40, 5)
    layers = parsed(plan).findall(f"{SVG}g")
    assert [layer.attrib[MODE] for layer in layers] == ["layer"] * 5
    assert [layer.attrib["stroke"] for layer in layers] == [to_hex(color) for color in plan.palette.color]
    assert layers[1].attrib[LABEL] == f"2 paint 2 {to_hex(plan.palette.color[1])} 8 strokes"
    assert all(layer.attrib["stroke-linecap"] == "round" and layer.attrib["fill"] == "none" for layer in layers)
    assert numbers_of_strokes(parsed(plan)) == list(range(1, 41))


def test_paints_that_come_back_get_another_layer_unless_order_does_not_matter() -> None:
    plan = made_up_plan(paint=[0, 0, 1, 2, 0, 2, 2])
    in_order = parsed(plan).findall(f"{SVG}g")
    assert [layer.attrib["data-paint"] for layer in in_order] == ["1", "2", "3", "1", "3"]
    assert numbers_of_strokes(parsed(plan)) == [1, 2, 3, 4, 5, 6, 7]
    merged = parsed(plan, keep_order=False)
    assert [layer.attrib["data-paint"] for layer in merged.findall(f"{SVG}g")] == ["1", "2", "3"]
    assert numbers_of_strokes(merged) == [1, 2, 5, 3, 4, 6, 7]


def test_a_plan_without_strokes_is_an_empty_page() -> None:
    none = torch.zeros(0, dtype=torch.long)
    empty = Plan.of(Strokes.empty(), Palette(torch.ones(1, 3)), none, canvas=CANVAS, brush="fine", limits=LIMITS)
    assert parsed(empty).findall(f"{SVG}g") == []


@pytest.mark.parametrize("width", [0.0, -1.0, float("nan"), 1.0])
def test_widths_that_cannot_be_are_refused(width: float) -> None:
    plan = made_up_plan(3)
    with pytest.raises(PlanError, match="needs a width"):
        svg(plan, torch.tensor([0.01, width, 0.01]))
    with pytest.raises(PlanError, match="needs a width"):
        svg(plan, torch.tensor([0.01]))


def test_dips_are_layers_whose_names_ask_a_plotter_to_pause() -> None:
    plan = made_up_plan(paint=[0, 0, 0, 1, 1])
    layers = parsed(plan, dips={0, 2, 3}).findall(f"{SVG}g")
    assert [layer.attrib[LABEL].split(" #")[0] for layer in layers] == ["!1 paint 1", "!2 paint 1", "!3 paint 2"]
    assert [len(layer) for layer in layers] == [2, 1, 2]
    with pytest.raises(PlanError, match="in painting order only"):
        parsed(plan, dips={0}, keep_order=False)


def test_svgpathtools_reads_the_strokes_back(tmp_path: Path) -> None:
    plan = made_up_plan(12)
    file = tmp_path / "plan.svg"
    file.write_text(svg(plan, torch.full((12,), 0.006), dips={0, 5}))
    paths, attributes = svgpathtools.svg2paths(str(file))
    assert [attribute["data-stroke"] for attribute in attributes] == [str(number) for number in range(1, 13)]
    for path, points in zip(paths, control_points(plan.strokes) * 1000, strict=True):
        (curve,) = path
        for read, (x, y) in zip(curve.bpoints(), points.tolist(), strict=True):
            assert abs(read - complex(x, 200 - y)) < 0.002


def test_vpype_reads_a_layer_for_each_paint_or_dip_in_millimetres(tmp_path: Path) -> None:
    vpype = installed("vpype")
    plan, millimetre = made_up_plan(12), 96 / 25.4
    file = tmp_path / "plan.svg"
    file.write_text(svg(plan, torch.full((12,), 0.006)))
    read = vpype.read_multilayer_svg(str(file), quantization=0.02)
    assert read.page_size == pytest.approx((300 * millimetre, 200 * millimetre))
    assert [layer.property("vp_color").as_hex() for layer in read.layers.values()] == [
        to_hex(color) for color in plan.palette.color
    ]
    counts = torch.bincount(plan.paint).tolist()
    assert [len(layer) for layer in read.layers.values()] == counts
    path = plan.strokes.path(torch.linspace(0, 1, 200))  # [n, t, 2]
    left, right = (float(end) * 1000 for end in (path[..., 0].min(), path[..., 0].max()))
    top, bottom = (200 - float(end) * 1000 for end in (path[..., 1].max(), path[..., 1].min()))
    assert read.bounds() == pytest.approx([edge * millimetre for edge in (left, top, right, bottom)], abs=0.2)
    file.write_text(svg(plan, torch.full((12,), 0.006), dips={0, 5}))
    dips = vpype.read_multilayer_svg(str(file), quantization=0.02)
    names = [layer.property("vp_name") for layer in dips.layers.values()]
    assert [name.startswith("!") for name in names].count(True) == 2, "a pause before each dip"
    assert sum(len(layer) for layer in dips.layers.values()) == 12


def test_a_paint_that_comes_back_in_another_layer_of_the_plan_gets_its_own_even_when_regrouped() -> None:
    plan = in_layers(made_up_plan(paint=[0, 1, 0, 1]), 2, 2)
    for layers in (parsed(plan).findall(f"{SVG}g"), parsed(plan, keep_order=False).findall(f"{SVG}g")):
        assert [(layer.attrib["data-layer"], layer.attrib["data-paint"]) for layer in layers] == [
            ("1", "1"), ("1", "2"), ("2", "1"), ("2", "2")
        ]  # fmt: skip
    assert parsed(plan).findall(f"{SVG}g")[2].attrib[LABEL].endswith("1 stroke layer 2")
