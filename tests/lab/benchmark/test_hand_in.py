import io
import re

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from frida_painter.canvas_size import CanvasSize
from frida_painter.errors import ConfigError, FridaError, HandInError
from frida_painter_lab.benchmark import hand_in, table
from frida_painter_lab.benchmark.hand_in import DrawnStroke, HandIn, draw, read_csv
from frida_painter_lab.benchmark.table import read_hand_in

CANVAS = CanvasSize(0.28, 0.21)
HEADER = "stroke,color,width_mm,x_mm,y_mm"


def csv_of(*rows: str, header: str = HEADER, comments: str = "# frida-painter strokes 1\n") -> bytes:
    return (comments + "\n".join((header, *rows)) + "\n").encode()


def refused(content: bytes) -> str:
    with pytest.raises(HandInError) as said:
        read_csv(content, "strokes.csv", CANVAS)
    sentence = str(said.value)
    assert sentence.endswith(".") and "\n" not in sentence and len(sentence) < 300
    return sentence


points = st.lists(st.tuples(st.floats(0, 280), st.floats(0, 210)), min_size=1, max_size=4)
drawn = st.lists(
    st.tuples(points, st.floats(0.5, 40), st.integers(0, 0xFFFFFF), st.floats(0.05, 1)), min_size=1, max_size=5
)


@settings(max_examples=30, deadline=None)
@given(drawn)
def test_what_is_written_is_read(strokes):
    strokes = [*strokes, ([(0.0, 0.0), (200.0, 100.0)], 4.0, 0, 1.0)]  # not all in one spot
    rows = [
        f"s{number},#{color:06x},{width!r},{x!r},{y!r},{opacity!r}"
        for number, (path, width, color, opacity) in enumerate(strokes)
        for x, y in path
    ]
    found = read_csv(csv_of(*rows, header=HEADER + ",opacity"), "strokes.csv", CANVAS)
    assert len(found.strokes) == len(strokes)
    for one, (path, width, color, opacity) in zip(found.strokes, strokes, strict=True):
        assert np.allclose(one.points * 1000, path, atol=1e-9)
        assert one.width == pytest.approx(width / 1000) and one.opacity == opacity
        assert [round(255 * part) for part in one.color] == [color >> 16, color >> 8 & 255, color & 255]


def test_the_ground_is_read_and_white_by_default():
    stroke = "1,#aa3311,4,10,10"
    assert read_csv(csv_of(stroke), "a.csv", CANVAS).ground == (1.0, 1.0, 1.0)
    toned = read_csv(csv_of(stroke, comments="# ground #ff0000\n"), "a.csv", CANVAS)
    assert toned.ground == (1.0, 0.0, 0.0)


@pytest.mark.parametrize(
    ("content", "told"),
    [
        (csv_of("1,#aa3311,4,nan,10"), "Line 3 .* x_mm 'nan'"),
        (csv_of("1,#aa3311,4,10,inf"), "y_mm 'inf'"),
        (csv_of("1,#aa3311,nan,10,10"), "width_mm 'nan'"),
        (csv_of("1,#aa3311,4,300,10"), r"lies at \(300, 10\) mm, off the canvas of 280 x 210 mm"),
        (csv_of("1,#aa3311,4,10,-40"), "off the canvas"),
        (csv_of("1,,4,10,10"), "color ''"),
        (csv_of("1,red,4,10,10"), "such as #aa3311"),
        (csv_of("1,#aa3311,4,10"), "4 of 5 columns"),
        (csv_of("1,#aa3311,0,10,10"), "0 mm wide; widths are from 0.1"),
        (csv_of("1,#aa3311,-3,10,10"), "-3 mm wide"),
        (csv_of("1,#aa3311,4000,10,10"), "4000 mm wide"),
        (csv_of("1,#aa3311,4,10,10", "1,#aa3312,4,20,10"), "changes its color, width or opacity"),
        (csv_of(), "no strokes"),
        (b"", "lacks the columns"),
        (csv_of("1,#aa3311,4,9,9", header="stroke,color,width_px,x_px,y_px"), "lacks the columns width_mm, x_mm, y_mm"),
        (csv_of("1,#aa3311,4,10,10", comments="# ground beige\n"), "ground"),
        (csv_of("1,#aa3311,4,10,10")[:-4] + b",", "y_mm ''"),
        (b"\xff\xfe\x00stroke", "UTF-8"),
        (csv_of('1,"#aa3311,4,10,10'), "cut off"),
        (csv_of("1,#aa3311,4,1_0,10"), "x_mm '1_0'"),
        (csv_of("1,#aa3311,\uff14,10,10"), "width_mm"),
        (csv_of("1,#aa3311,4,9,9,9", header=HEADER + ",x_mm"), "the columns x_mm twice"),
        (csv_of("1,#aa3311,4,0.01,0.02", "2,#aa3311,4,0.27,0.2"), r"lie within 0\.26 x 0\.18 mm .* check the unit"),
        (csv_of("1,#aa3311,4,10,10,0", header=HEADER + ",opacity"), "opacity 0"),
    ],
)  # fmt: skip
def test_bad_strokes_are_refused_in_one_sentence(content, told):
    assert re.search(told, refused(content))


def test_too_many_strokes_are_refused_before_all_are_read(monkeypatch):
    monkeypatch.setattr(hand_in, "MAX_STROKES", 50)
    read = []
    rows = "\n".join(f"{number},#aa3311,4,10,10" for number in range(10_000))
    monkeypatch.setattr(hand_in, "_number", lambda *given: read.append(given) or 4.0)
    assert "more than 50 strokes" in refused(csv_of(rows))
    assert len(read) < 1000


def test_a_huge_file_is_refused_by_its_size(tmp_path, monkeypatch):
    monkeypatch.setattr(table, "MAX_BYTES", 1000)
    path = tmp_path / "strokes.csv"
    path.write_bytes(csv_of(*["1,#aa3311,4,10,10"] * 100))
    with pytest.raises(HandInError):
        read_hand_in(path, CANVAS)


@pytest.mark.parametrize("name", ["strokes.txt", "missing.csv", "missing.svg", "plan.json"])
def test_other_and_missing_files_are_refused(tmp_path, name):
    if name == "strokes.txt":
        (tmp_path / name).write_text("x")
    with pytest.raises(FridaError) as said:
        read_hand_in(tmp_path / name, CANVAS)
    assert str(said.value).endswith(".")
    assert name != "strokes.txt" or isinstance(said.value, ConfigError)


def test_a_transparent_stroke_shows_what_lies_below():
    points = np.array([[0.05, 0.1], [0.2, 0.1]])
    black = DrawnStroke(points, 0.02, (0.0, 0.0, 0.0))
    half = DrawnStroke(points, 0.01, (1.0, 0.0, 0.0), 0.5)
    picture, shown = draw(HandIn(CANVAS, (black, half), (1.0, 1.0, 1.0)), 210, 280)
    assert np.allclose(shown[0], 0, atol=0.02)
    assert np.allclose(shown[1], (0.5, 0, 0), atol=0.02)
    assert np.allclose(picture[110, 120], (0.5, 0, 0), atol=0.02) and np.allclose(picture[20, 20], 1)
    dark = (picture[:, 120] < 0.5).any(-1)
    assert abs(dark.sum() - 20) <= 1 and dark[101:119].all(), "20 mm wide, and y points up"


def test_a_stroke_of_one_point_is_a_dot():
    dot = DrawnStroke(np.array([[0.1, 0.1]]), 0.02, (0.0, 0.0, 0.0))
    picture, _ = draw(HandIn(CANVAS, (dot,)), 210, 280)
    assert (1 - picture.mean(-1)).sum() == pytest.approx(np.pi * 10**2, rel=0.08)


def test_csv_with_a_byte_order_mark_and_windows_lines_is_read():
    content = b"\xef\xbb\xbf" + csv_of("1,#aa3311,4,10,10", "1,#aa3311,4,30,10").replace(b"\n", b"\r\n")
    assert len(read_csv(content, "a.csv", CANVAS).strokes[0].points) == 2
    assert io.BytesIO(content).read(3) == b"\xef\xbb\xbf"
