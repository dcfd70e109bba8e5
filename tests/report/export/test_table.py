import csv
import io
import math

import pytest
import torch

from frida_painter.report.vector import COLUMNS, table
from frida_painter.strokes.palette import to_hex
from support.plans import in_layers, made_up_plan


def test_every_stroke_has_a_row_that_reads_back() -> None:
    plan = made_up_plan(25, 4)
    rows = list(csv.DictReader(io.StringIO(table(plan))))
    assert len(rows) == 25 and tuple(rows[0]) == COLUMNS
    ends = plan.strokes.path(torch.tensor([0.0, 1.0]))
    for index, row in enumerate(rows):
        strokes, paint = plan.strokes, int(plan.paint[index])
        assert (row["stroke"], row["paint"]) == (str(index + 1), str(paint + 1))
        assert row["color"] == to_hex(plan.palette.color[paint])
        start, end = ends[index].tolist()
        found = [float(row[f"{place}_{axis}_mm"]) / 1000 for place in ("start", "end") for axis in "xy"]
        assert found == pytest.approx([*start, *end], abs=2e-6)
        assert float(row["length_mm"]) == pytest.approx(float(strokes.length[index]) * 1000, abs=1e-3)
        assert float(row["bend_mm"]) == pytest.approx(float(strokes.bend[index]) * 1000, abs=1e-3)
        assert float(row["thickness"]) == pytest.approx(float(strokes.thickness[index]), abs=1e-4)
        assert math.isclose(
            math.cos(math.radians(float(row["angle_deg"]))), math.cos(strokes.angle[index]), abs_tol=1e-4
        )
        assert -180 <= float(row["angle_deg"]) <= 180


def test_the_bezier_begins_and_ends_where_the_stroke_does() -> None:
    for row in csv.DictReader(io.StringIO(table(made_up_plan(10)))):
        for axis in "xy":
            assert row[f"bezier0_{axis}_mm"] == row[f"start_{axis}_mm"]
            assert row[f"bezier3_{axis}_mm"] == row[f"end_{axis}_mm"]


def test_rows_tell_their_layer() -> None:
    plan = in_layers(made_up_plan(6, 2), 4, 2)
    assert [row["layer"] for row in csv.DictReader(io.StringIO(table(plan)))] == ["1"] * 4 + ["2"] * 2
