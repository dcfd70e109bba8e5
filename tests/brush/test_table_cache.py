import pytest
import torch

from frida_painter.brush import table
from frida_painter.brush.kinds import StrokeFunction
from frida_painter.brush.table import StrokeTable, TableDetail, cached_table
from frida_painter.errors import ConfigError
from frida_painter_calibration.teaching.bezier import BezierStroke
from marks import SMALL, ribbon, shapes, small_frame

DETAIL = TableDetail(spans=(2, 3, 3), rank=12)


def same(one, other):
    return all(torch.equal(part, other.get_buffer(name)) for name, part in one.named_buffers())


def test_a_table_is_made_once_and_read_again_to_the_bit(tmp_path, monkeypatch):
    made = cached_table(ribbon(), DETAIL, tmp_path)
    assert same(made, StrokeTable.of(ribbon(), detail=DETAIL))
    monkeypatch.setattr(StrokeTable, "from_samples", None)
    again = cached_table(ribbon(), DETAIL, tmp_path)
    assert same(again, made) and torch.equal(again(*shapes(5)), made(*shapes(5)))
    assert (again.brush, again.frame, again.limits, again.detail) == (made.brush, made.frame, made.limits, DETAIL)


def test_another_model_or_detail_has_another_table(tmp_path):
    cached_table(ribbon(), DETAIL, tmp_path)
    wider = ribbon()
    with torch.no_grad():
        next(wider.parameters()).add_(0.01)
    cached_table(wider, DETAIL, tmp_path)
    cached_table(ribbon(12, 20), DETAIL, tmp_path)
    cached_table(ribbon(), TableDetail(spans=(2, 3, 4), rank=12), tmp_path)
    assert len(list(tmp_path.iterdir())) == 4


def stripe(width):
    """A stroke model that is only a function: a straight stripe, as wide as it is told."""
    frame = small_frame()
    x, y = frame.cell_centers().unbind(-1)

    def marks(thickness, length, bend):
        on = (x > 0) & (x < length[:, None, None])
        return on * (1 - (y.abs() / (width * (0.5 + thickness[:, None, None])))).clamp(0, 1)

    return StrokeFunction(SMALL, marks, frame)


def test_a_model_that_is_only_a_function_is_known_by_what_it_gives(tmp_path, monkeypatch):
    made = cached_table(stripe(0.004), DETAIL, tmp_path)
    assert same(made, StrokeTable.of(stripe(0.004), detail=DETAIL))
    cached_table(stripe(0.005), DETAIL, tmp_path)
    assert len(list(tmp_path.iterdir())) == 2
    monkeypatch.setattr(StrokeTable, "from_samples", None)
    assert same(cached_table(stripe(0.004), DETAIL, tmp_path), made)


def test_a_network_of_someone_elses_is_known_by_what_it_gives_as_well(tmp_path):
    class Fainter(BezierStroke):
        """The same weights, another program: what a researcher changes between two runs."""

        def forward(self, thickness, length, bend):
            return 0.5 * super().forward(thickness, length, bend)

    known = ribbon()
    fainter = Fainter("small", known.frame, known.limits, known.ribbon).requires_grad_(False)
    coarse = TableDetail(spans=(1, 2, 2), rank=4)
    plain, half = (cached_table(model, coarse, tmp_path)(*shapes(8)) for model in (known, fainter))
    Fainter.forward = BezierStroke.forward
    assert torch.equal(cached_table(fainter, coarse, tmp_path)(*shapes(8)), plain) and half.sum() < 0.7 * plain.sum()


@pytest.mark.parametrize(
    ("marks", "says"),
    [
        (
            lambda h, *_: torch.zeros(len(h), 3, 3),
            r"maps of shape \(2, 3, 3\); its function has to return \(2, 24, 42\)",
        ),
        (lambda h, *_: torch.full((len(h), 24, 42), 1.5), "magnitudes from 1.5 to 1.5"),
        (lambda h, *_: torch.full((len(h), 24, 42), float("nan")), "magnitudes from nan to nan"),
    ],
)
def test_a_function_that_gives_no_marks_is_told(marks, says):
    with pytest.raises(ConfigError, match=says):
        StrokeFunction(SMALL, marks, small_frame())(*shapes(2))


@pytest.mark.parametrize("content", [b"", b"nonsense", "cut", "another's"])
def test_a_damaged_one_is_made_anew(tmp_path, content):
    made = cached_table(ribbon(), DETAIL, tmp_path)
    (path,) = tmp_path.iterdir()
    whole = path.read_bytes()
    if content == "cut":
        content = whole[: len(whole) // 2]
    elif content == "another's":
        cached_table(ribbon(12, 20), DETAIL, tmp_path)
        content = next(one for one in tmp_path.iterdir() if one != path).read_bytes()
    path.write_bytes(content)
    assert same(cached_table(ribbon(), DETAIL, tmp_path), made)
    assert path.read_bytes() == whole


def test_without_a_folder_to_write_to_it_is_made_every_time(tmp_path):
    (tmp_path / "file").touch()
    assert same(cached_table(ribbon(), DETAIL, tmp_path / "file"), StrokeTable.of(ribbon(), detail=DETAIL))


def test_only_so_many_are_kept(tmp_path, monkeypatch):
    monkeypatch.setattr(table, "_MAX_KEPT", 2)
    for columns in (14, 16, 18):
        cached_table(ribbon(8, columns), TableDetail(spans=(1, 1, 1), rank=2), tmp_path)
    assert len(list(tmp_path.iterdir())) == 2
