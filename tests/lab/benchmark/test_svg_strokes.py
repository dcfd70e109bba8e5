import re

import numpy as np
import pytest
import torch

from frida_painter.canvas_size import CanvasSize
from frida_painter.errors import HandInError
from frida_painter.report.vector import control_points, svg
from frida_painter.strokes.palette import Palette
from frida_painter.strokes.plan import Plan
from frida_painter.strokes.strokes import StrokeLimits, Strokes
from frida_painter_lab.benchmark import svg_strokes
from frida_painter_lab.benchmark.svg_strokes import read_svg

pytest.importorskip("svgelements")
CANVAS = CanvasSize(0.28, 0.21)
PAGE = 'width="280mm" height="210mm" viewBox="0 0 280 210"'


def document(body: str, page: str = PAGE, before: str = "") -> bytes:
    return f'<?xml version="1.0"?>{before}<svg xmlns="http://www.w3.org/2000/svg" {page}>{body}</svg>'.encode()


def line(x1=10, y1=20, x2=60, y2=20, more='stroke="#aa3311" stroke-width="4"') -> str:
    return f'<line x1="{x1}" y1="{y1}" x2="{x2}" y2="{y2}" {more}/>'


def refused(content: bytes) -> str:
    with pytest.raises(HandInError) as said:
        read_svg(content, "a.svg", CANVAS)
    sentence = str(said.value)
    assert sentence.endswith(".") and "\n" not in sentence and len(sentence) < 300
    return sentence


def test_an_exported_plan_is_read_as_it_is():
    """The oracle is the export of plans, which knows nothing of hand-ins."""
    random = torch.Generator().manual_seed(3)
    count = 12
    strokes = Strokes(
        torch.rand(count, 2, generator=random) * torch.tensor([0.2, 0.15]) + 0.03,
        torch.rand(count, generator=random) * 6, 0.03 + 0.02 * torch.rand(count, generator=random),
        0.01 * torch.rand(count, generator=random), torch.full((count,), 0.5), torch.rand(count, 3, generator=random),
    )  # fmt: skip
    limits = StrokeLimits((0.01, 0.06), (-0.016, 0.016))
    palette = Palette(torch.tensor([[1.0, 0.0, 0.2], [0.0, 0.4, 1.0]]))
    paint = torch.arange(count) % 2
    plan = Plan.of(strokes.project(limits, CANVAS), palette, paint, canvas=CANVAS, brush="medium", limits=limits)
    width = torch.linspace(0.004, 0.012, count)
    found = read_svg(svg(plan, width).encode(), "plan.svg", CANVAS)
    assert len(found.strokes) == count and found.ground == (1.0, 1.0, 1.0)
    ends = control_points(plan.strokes)[:, [0, 3]].numpy()
    for number, one in enumerate(found.strokes):
        assert np.allclose(one.points[[0, -1]], ends[number], atol=2e-6)
        assert one.width == pytest.approx(float(width[number]), abs=2e-6)
        assert np.allclose(one.color, palette.color[paint[number]].numpy(), atol=1 / 255)


BOX = 'viewBox="0 0 280 210"'


@pytest.mark.parametrize(
    "page",
    [
        PAGE, BOX, f'width="28cm" height="21cm" {BOX}', f'width="11.0236in" height="8.2677in" {BOX}',
        'width="280" height="210"', f'width="100%" height="100%" {BOX}', f'width="1120px" height="840px" {BOX}',
        'width="280mm" height="210mm" viewBox="-10 -5 280 210"',
    ],
)  # fmt: skip
def test_a_page_of_any_unit_is_the_canvas(page):
    (one,) = read_svg(document(line(), page), "a.svg", CANVAS).strokes
    shift = np.array([10, -5]) if "-10" in page else np.zeros(2)
    assert np.allclose(one.points * 1000, np.array([[10, 190], [60, 190]]) + shift, atol=0.02)
    assert one.width == pytest.approx(0.004, abs=1e-5)


def test_transforms_styles_and_opacity_are_resolved():
    body = (
        '<rect x="0" y="0" width="280" height="210" fill="#c8a878"/><style>.s { stroke: #0000ff }</style>'
        '<g transform="translate(20 30) scale(2)" opacity="50%" fill="none" stroke-width="3">'
        '<path class="s" d="M0 0 L10 0 M20 0 Q25 5 30 0" stroke-opacity="0.5"/></g>'
    )
    found = read_svg(document(body), "a.svg", CANVAS)
    assert np.allclose(found.ground, np.array([0xC8, 0xA8, 0x78]) / 255)
    straight, curved = found.strokes
    assert np.allclose(straight.points * 1000, [[20, 180], [40, 180]], atol=0.01)
    assert straight.width == pytest.approx(0.006, abs=1e-5) and straight.opacity == pytest.approx(0.25, abs=0.01)
    assert straight.color == (0.0, 0.0, 1.0)
    assert np.allclose(curved.points[[0, 8, -1]] * 1000, [[60, 180], [70, 175], [80, 180]], atol=0.01)


def test_a_filled_ellipse_and_a_rotated_rectangle_become_strokes():
    body = (
        '<g transform="translate(140 105) rotate(30) scale(40 10)"><ellipse rx="1" ry="1" fill="#ff0000"/></g>'
        '<rect x="20" y="50" width="60" height="10" fill="#00ff00" fill-opacity="0.5"/>'
    )
    found = read_svg(document(body), "a.svg", CANVAS)
    ellipse, bar = found.strokes
    assert ellipse.width == pytest.approx(0.02, rel=0.02)
    step = ellipse.points[1] - ellipse.points[0]
    assert np.hypot(*step) == pytest.approx(0.06, rel=0.03)
    assert abs(np.degrees(np.arctan2(step[1], step[0])) % 180 - 150) < 1, "the page's y points down"
    assert np.allclose(sorted(bar.points[:, 0] * 1000), [25, 75], atol=0.1)
    assert bar.opacity == pytest.approx(0.5, abs=0.01)
    assert any("2 filled" in remark for remark in found.remarks)


TRIANGLE = '<polygon points="20,20 120,20 20,80"'
FRAME = '<path fill-rule="evenodd" d="M20 20 H110 V110 H20 Z M50 50 V80 H80 V50 Z"'
CORNER = '<path transform="translate(20 10)" d="M0 0 H160 V40 H40 V160 H0 Z"'


@pytest.mark.parametrize(
    ("shape", "holds"),
    [
        (TRIANGLE, lambda x, y: (x > 20) & (y > 20) & ((x - 20) / 100 + (y - 20) / 60 < 1)),
        (FRAME, lambda x, y: (abs(x - 65) < 45) & (abs(y - 65) < 45) & ((abs(x - 65) > 15) | (abs(y - 65) > 15))),
        (CORNER, lambda x, y: (x > 20) & (y > 10) & (x < 180) & (y < 170) & ((y < 50) | (x < 60))),
    ],
)
def test_any_other_filled_shape_is_hatched(shape: str, holds):
    found = read_svg(document(f'{shape} fill="#aa3311"/>'), "a.svg", CANVAS)
    y, x = np.mgrid[:210, :280] + 0.5  # millimetres of the page
    hatched = np.zeros((210, 280), bool)
    for stroke in found.strokes:
        start, end = stroke.points * 1000 * (1, -1) + (0, 210)
        step = end - start
        share = (((x - start[0]) * step[0] + (y - start[1]) * step[1]) / max(step @ step, 1e-9)).clip(0, 1)
        hatched |= np.hypot(x - start[0] - share * step[0], y - start[1] - share * step[1]) <= stroke.width * 500
    assert len(found.strokes) > 1 and any("1 filled shape hatched" in remark for remark in found.remarks)
    wanted = holds(x, y)
    assert (hatched & wanted).sum() > 0.97 * wanted.sum()
    assert (hatched & ~wanted).sum() < 0.35 * wanted.sum()


def test_what_leaves_the_page_is_cut_and_told():
    upright = line(x1=100, y1=-50, x2=100, y2=260)
    bent = '<polyline points="240,50 290,100 240,150 240,160" fill="none" stroke="#aa3311"/>'
    body = [line(x1=-40, x2=40), upright, line(x1=400, x2=420), bent, line(), line(y1=50, y2=50)]
    found = read_svg(document("".join(body)), "a.svg", CANVAS)
    assert np.allclose(found.strokes[0].points * 1000, [[0, 190], [40, 190]], atol=0.01)
    assert np.allclose(found.strokes[1].points * 1000, [[100, 210], [100, 0]], atol=0.01)
    assert np.allclose(found.strokes[2].points * 1000, [[240, 160], [280, 120]], atol=0.01)
    assert np.allclose(found.strokes[3].points * 1000, [[280, 100], [240, 60], [240, 50]], atol=0.01)
    assert found.remarks == (
        "3 strokes lost what lay beyond the edge of the page.",
        "1 stroke left out: beside the page.",
    )


THICK = 'stroke="#aa3311" stroke-width="400"'
BOMB = (
    '<!DOCTYPE svg [<!ENTITY a "aaaaaaaaaa"><!ENTITY b "&a;&a;&a;&a;&a;&a;&a;&a;"><!ENTITY c "&b;&b;&b;&b;&b;&b;&b;">]>'
)
OUTSIDE = '<!DOCTYPE svg [<!ENTITY x SYSTEM "file:///etc/passwd">]>'


@pytest.mark.parametrize(
    ("content", "told"),
    [
        (document("<title>&c;</title>" + line(), before=BOMB), "DOCTYPE with declarations"),
        (document("<title>&x;</title>" + line(), before=OUTSIDE), "DOCTYPE with declarations"),
        (document("<script>alert(1)</script>" + line()), "a script"),
        (document(line(more='stroke="#aa3311" onload="alert(1)"')), "a script"),
        (document('<image href="http://example.org/a.png"/>'), "a picture"),
        (document('<use href="#a"/>'), "a reference"),
        (document(line(more='stroke="url(http://example.org/a#b)"')), "another file"),
        (document('<style>@import "http://example.org/a.css";</style>' + line()), "a style from elsewhere"),
        (document(line(), before='<?xml-stylesheet href="http://example.org/a.css"?>'), "xml-stylesheet"),
        (document("<foreignObject/>"), "foreign content"),
        (document("<svg/>"), "another SVG"),
        (document("<text x='1' y='2'>a</text>"), "text"),
        (document("<g>" * 100 + line() + "</g>" * 100), "in more than 64 others"),
        (document(line(), 'viewBox="0 0 1e30 1e30"'), "beyond"),
        (document(line(), 'viewBox="0 0 nan 210"'), "it has four numbers"),
        (document(line(), 'viewBox="0 0 280mm 210"'), "it has four numbers"),
        (document(line(), ""), "neither width nor viewBox"),
        (document(line(), 'viewBox="0 0 -280 -210"'), "beyond"),
        (document(line(), 'viewBox="0 0 0 0"'), "beyond"),
        (document(line(), 'width="20em" height="15em"'), "'em'"),
        (document(line(), 'width="500mm" height="500mm"'), "500.0 x 500.0 mm, and this picture is painted on 280"),
        (document(line(), 'viewBox="0 0 285 210"'), "other proportions"),
        (document(line(), 'width="282mm" height="210mm"'), "282.0 x 210.0 mm"),
        (document('<rect width="280" height="210" fill="#aa3311"/>' * 2), "210 mm wide"),  # the second is no ground
        (document('<rect width="280" height="200.1" fill="#aa3311"/>'), "200.1 mm wide"),
        (document(line())[:-30], "cut off"),
        (b"", "cut off"),
        (b"<html></html>", "its root is 'html'"),
        (document(""), "no strokes"),
        (document('<path d="M0 0 L50 50"/>'), "no stroke colour"),
        (document(line(more="")), "no stroke colour"),
        (document('<path d="M0 0 L50 0 z" fill="#ff0000"/>'), "no strokes"),
        (document(line(more='stroke="beige-ish" stroke-width="4"')), "'beige-ish', which is no colour"),
        (document(line(more='stroke="#12" stroke-width="4"')), "'#12', which is no colour"),
        (document('<path d="M0 0 L nan 50" stroke="#aa3311"/>'), "not finite"),
        (document(line(more='stroke="#aa3311" stroke-width="900"')), "900 mm wide"),
        (document(line(x2="nan")), "the x2 'nan', which is not finite"),
        (document(line(more='stroke="#aa3311" stroke-width="4" stroke-opacity="nan"')), "stroke-opacity 'nan'"),
        (document(line(more='style="stroke:#aa3311;stroke-width:inf"')), "not finite"),
        (document(line(more='stroke="#aa3311" opacity="much"')), "the opacity 'much'; it is a number"),
        (document('<path d="hello" stroke="#aa3311"/>'), "is no SVG; check its commands"),
        (document("<mask><rect width='9' height='9' fill='#ffffff'/></mask>" + line()), "a mask"),
        (document("<marker/>" + line()), "a marker"),
        (document(line()).replace(b'"1.0"', b'"1.0" encoding="klingon"'), "unknown encoding"),
        (document(f"<g transform='scale(0.01)'>{line(more=THICK) * 2}</g>"), "lie within 0.5 x 0 mm .* check the unit"),
        (document("".join(line(x1=1000 + n, x2=2000, y1=900, y2=900) for n in range(5))), "lie off its page"),
    ],
)
def test_hostile_and_useless_documents_are_refused_in_one_sentence(content, told):
    assert re.search(told, refused(content))


def test_what_no_screen_shows_is_left_out_and_clips_are_told():
    hidden, off = (line(more=f'stroke="#aa3311" {how}') for how in ('visibility="hidden"', 'display="none"'))
    found = read_svg(document(f'<g clip-path="url(#c)">{line(y1=30, y2=30)}{hidden}{off}</g>'), "a.svg", CANVAS)
    assert len(found.strokes) == 1 and found.remarks == ("The clip path of 1 element was ignored.",)


def zigzag(points: int) -> str:
    return f'<path d="M0 0 {"L5 5 " * points}" stroke="#000"/>'


@pytest.mark.parametrize(
    ("limit", "few", "body", "told"),
    [
        ("MAX_POINTS", 100, zigzag(30) * 4, "more than 100 points"),  # over all paths
        ("_MAX_ELEMENTS", 100, line() * 200, "more than 100 elements"),
        ("MAX_STROKES", 50, line() * 200, "more than 50 strokes"),
        ("_MAX_PATH", 100, zigzag(100), "more than 100 characters"),
    ],
)
def test_what_is_too_large_is_refused_before_it_is_drawn(limit: str, few: int, body: str, told: str, monkeypatch):
    monkeypatch.setattr(svg_strokes, limit, few)
    monkeypatch.setattr(svg_strokes, "_lines_of", lambda shape: pytest.fail("drawn"))
    assert told in refused(document(body))


def test_points_of_curves_are_counted_when_they_are_drawn(monkeypatch):
    monkeypatch.setattr(svg_strokes, "MAX_POINTS", 100)
    assert len(read_svg(document(zigzag(30) * 3), "a.svg", CANVAS).strokes) == 3
    assert "100 points" in refused(document(f'<path d="M0 0 {"C5 5 6 6 9 9 " * 10}" stroke="#000"/>'))
