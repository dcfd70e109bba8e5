from pathlib import Path

import pytest
import torch

from frida_painter.errors import WeightsError
from frida_painter.objectives.pictograms import Pictograms
from networks import WordBag, write_pictograms


@pytest.fixture
def pictograms(tmp_path: Path) -> Pictograms:
    return Pictograms(write_pictograms(tmp_path / "pictograms.zip"), WordBag(), tmp_path / "meanings")


def test_words_find_the_drawing_that_is_called_so(pictograms: Pictograms) -> None:
    found = pictograms.nearest(["a red strawberry", "strawberry"])
    assert found is not None and found.name == "strawberry" and found.file == "1F353.svg"
    assert 0.55 <= found.similarity <= 1
    assert pictograms.nearest(["a lighthouse"]) is None, "none is like enough"


def test_what_is_akin_comes_in_the_order_of_likeness(pictograms: Pictograms) -> None:
    first, second = pictograms.kindred("an umbrella", 2)
    assert (first.name, second.name) == ("umbrella", "strawberry") and first.similarity > second.similarity


def test_drawings_are_cut_to_what_is_drawn_without_and_with_outlines(pictograms: Pictograms) -> None:
    plain, outlined = pictograms.drawings(pictograms.nearest(["strawberry"]))
    assert plain.shape[0] == 4 and plain.shape[1] == plain.shape[2] == pytest.approx(20 / 72 * 512, abs=2)
    assert torch.allclose(plain[:, 70, 70], torch.tensor([1.0, 0, 0, 1])) and float(plain[:3, 2, 70].sum()) > 0.9
    assert outlined.shape[1] == pytest.approx(22 / 72 * 512, abs=2) and float(outlined[:3, 4, 70].sum()) < 0.1


def test_where_outlines_are_all_there_is_they_stay(pictograms: Pictograms) -> None:
    (drawing,) = pictograms.drawings(pictograms.nearest(["umbrella"]))
    assert float(drawing[3].max()) == 1 and float(drawing[:3].max()) < 0.1


def test_an_archive_that_is_none_is_refused(tmp_path: Path) -> None:
    (tmp_path / "bad.zip").write_bytes(b"no archive")
    with pytest.raises(WeightsError, match="fetch openmoji again"):
        Pictograms(tmp_path / "bad.zip", WordBag(), tmp_path)
