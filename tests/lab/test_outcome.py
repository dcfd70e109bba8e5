import json
import math

import pytest
import torch
from PIL import Image

from frida_painter.lab.trials import Outcome, Progress, ResultTable, within

ROWS = (
    {"model": "a | b", "error": 0.123456, "n": 3, "better": True},
    {"model": "c", "error": math.nan, "n": None, "better": False},
)


def outcome() -> Outcome:
    return Outcome(
        "trial",
        "A trial",
        {"seeds": (0, 1), "brush": "fine"},
        (ResultTable("Errors", ROWS),),
        ("It works.",),
        {"a-picture": torch.rand(3, 20, 30)},
    )


def test_what_is_written_is_what_was_found(tmp_path):
    outcome().save(tmp_path / "trial")
    record = json.loads((tmp_path / "trial" / "table.json").read_text())
    assert record["experiment"] == "trial" and record["settings"] == {"seeds": [0, 1], "brush": "fine"}
    first, second = record["tables"][0]["rows"]
    assert first == ROWS[0]
    assert second["error"] is None and second["better"] is False
    assert record["pictures"] == ["a-picture.png"]
    with Image.open(tmp_path / "trial" / "a-picture.png") as picture:
        assert picture.size == (30, 20)


def test_markdown_is_a_table_that_survives_bars():
    lines = outcome().markdown().splitlines()
    assert "| model | error | n | better |" in lines
    assert "| --- | ---: | ---: | --- |" in lines
    assert r"| a \| b | 0.1235 | 3 | yes |" in lines
    assert "| c | - | - | no |" in lines
    assert "It works." in lines and "![a picture](a-picture.png)" in lines


@pytest.mark.parametrize(("share", "told"), [(0.0, 0.2), (0.5, 0.4), (1.0, 0.6)])
def test_a_part_tells_its_progress_as_part_of_the_whole(share, told):
    heard = []
    within(heard.append, 0.2, 0.6)(Progress(share, "counting"))
    assert heard[0].doing == "counting" and heard[0].share == pytest.approx(told)
