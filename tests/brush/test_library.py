import io
import zipfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from frida_painter.brush.library import StrokeLibrary, resample
from frida_painter.errors import LibraryError
from frida_painter.frames import MapFrame
from marks import ribbon, shapes, small_frame, small_library


@pytest.fixture
def saved(tmp_path: Path) -> Path:
    small_library(4).save(tmp_path / "library.npz")
    return tmp_path / "library.npz"


def arrays(path: Path) -> dict[str, np.ndarray]:
    with np.load(path, allow_pickle=False) as stored:
        return dict(stored)


def test_it_comes_back_as_it_was(saved):
    library, again = small_library(4), StrokeLibrary.load(saved)
    assert len(again) == 4
    assert again.metres_per_pixel == library.metres_per_pixel
    assert again.origin_px == pytest.approx(library.origin_px)
    for name in ("magnitude", "length_m", "bend_m", "thickness", "recorded_index"):
        np.testing.assert_array_equal(getattr(again, name), getattr(library, name))


def test_a_judgement_is_kept_and_goes_with_its_strokes(saved):
    assert StrokeLibrary.load(saved).flaws is None
    judged = replace(small_library(4), flaws=np.array([0, 3, 0, 1], np.uint8))
    judged.save(saved)
    again = StrokeLibrary.load(saved)
    assert again.flaws.tolist() == [0, 3, 0, 1]
    assert again[np.array([3, 0])].flaws.tolist() == [1, 0]


@pytest.mark.parametrize("flaws", [np.zeros(3, np.uint8), np.full(4, 99, np.uint8), np.zeros((4, 1), np.uint8)])
def test_a_judgement_that_cannot_be_is_refused(saved, flaws):
    np.savez(saved, **{**arrays(saved), "flaws": flaws})
    with pytest.raises(LibraryError, match="flaws"):
        StrokeLibrary.load(saved)


def test_crops_on_a_models_frame_lie_where_the_model_paints():
    library = small_library(8)
    painted = ribbon()(*shapes(8))
    maps = library.maps(small_frame())
    assert maps.shape == painted.shape
    assert (maps - painted).abs().mean() < 0.02
    shifted = (maps.roll(1, 2) - painted).abs().mean()
    assert (maps - painted).abs().mean() < 0.3 * shifted


@pytest.mark.parametrize(
    "changes",
    [
        {"magnitude": np.zeros((4, 72, 126), np.float32)},
        {"magnitude": np.zeros((3, 72, 126), np.uint8)},
        {"magnitude": np.zeros((4, 60), np.uint8)},
        {"magnitude": np.zeros((0, 72, 126), np.uint8)},
        {"length_m": np.array([0.1, np.nan, 0.1, 0.1])},
        {"length_m": np.array([0.1, -0.1, 0.1, 0.1])},
        {"bend_m": np.array([0.1, np.inf, 0.1, 0.1])},
        {"bend_m": np.array(["a", "b", "c", "d"])},
        {"thickness": np.array([0.1, 1.5, 0.1, 0.1])},
        {"thickness": np.zeros((4, 1))},
        {"metres_per_pixel": np.array(0.0)},
        {"metres_per_pixel": np.array([0.1, 0.1])},
        {"metres_per_pixel": np.array(np.nan)},
        {"origin_px": np.array([np.nan, 0])},
        {"origin_px": np.array([1.0])},
        {"recorded_index": np.arange(3)},
        {"recorded_index": np.zeros(4)},
        {"length_m": np.zeros(4, dtype=[("a", float)])},
    ],
)
def test_parts_that_cannot_be_true_are_refused(saved, changes):
    np.savez(saved, **{**arrays(saved), **changes})
    with pytest.raises(LibraryError):
        StrokeLibrary.load(saved)


def test_a_missing_part_is_named(saved):
    rest = arrays(saved)
    del rest["bend_m"], rest["origin_px"]
    np.savez(saved, **rest)
    with pytest.raises(LibraryError, match="bend_m, origin_px"):
        StrokeLibrary.load(saved)


class _Bomb:
    def __reduce__(self):
        return (pytest.fail, ("a pickle was run",))


def test_a_pickle_is_never_run(saved):
    np.savez(saved, **{**arrays(saved), "thickness": np.array([_Bomb()] * 4, dtype=object)})
    with pytest.raises(LibraryError):
        StrokeLibrary.load(saved)


@pytest.mark.parametrize("keep", [0, 1, 30, 200, -30, -1])
def test_a_file_that_was_cut_is_refused(saved, keep):
    saved.write_bytes(saved.read_bytes()[:keep])
    with pytest.raises(LibraryError):
        StrokeLibrary.load(saved)


def test_an_array_that_claims_to_be_huge_is_refused(saved):
    header = io.BytesIO()
    np.lib.format.write_array_header_1_0(
        header, {"descr": "|u1", "fortran_order": False, "shape": (2000, 100_000, 100_000)}
    )
    rest = arrays(saved)
    del rest["magnitude"]
    np.savez(saved, **rest)
    with zipfile.ZipFile(saved, "a") as archive:
        archive.writestr("magnitude.npy", header.getvalue())
    with pytest.raises(LibraryError):
        StrokeLibrary.load(saved)


def test_a_folder_a_missing_file_and_another_kind_of_file_are_refused(tmp_path):
    (tmp_path / "text.npz").write_text("strokes")
    np.save(tmp_path / "single.npy", np.zeros(3))
    for path in (tmp_path, tmp_path / "nowhere.npz", tmp_path / "text.npz", tmp_path / "single.npy"):
        with pytest.raises(LibraryError):
            StrokeLibrary.load(path)


GIVEN = MapFrame(-0.01, 0.05, -0.02, 0.02, 40, 60)


def mark() -> torch.Tensor:
    maps = torch.zeros(1, 40, 60, dtype=torch.float64)
    maps[0, 10:20, 15:40] = 0.8
    return maps


def area(maps: torch.Tensor, frame: MapFrame) -> float:
    return float(maps.sum()) * frame.pitch[0] * frame.pitch[1]


@pytest.mark.parametrize("wanted", [MapFrame(-0.013, 0.056, -0.025, 0.021, 17, 23), GIVEN.resize(7, 11)])
def test_larger_cells_hold_the_same_paint(wanted):
    assert area(resample(mark(), GIVEN, wanted), wanted) == pytest.approx(area(mark(), GIVEN))


def test_the_same_cells_give_the_same_map():
    torch.testing.assert_close(resample(mark(), GIVEN, GIVEN), mark())


def test_smaller_cells_are_interpolated():
    finer = resample(mark(), GIVEN, GIVEN.resize(80, 120))
    assert area(finer, GIVEN.resize(80, 120)) == pytest.approx(area(mark(), GIVEN))
    assert finer.max() == pytest.approx(0.8)


def test_beyond_the_given_frame_there_is_nothing():
    elsewhere = MapFrame(0.06, 0.08, -0.01, 0.01, 4, 4)
    assert not resample(torch.ones(1, 40, 60), GIVEN, elsewhere).any()


def test_rows_go_down_from_the_top():
    upper = MapFrame(-0.01, 0.05, 0.0, 0.02, 10, 60)
    assert area(resample(mark(), GIVEN, upper), upper) == pytest.approx(area(mark(), GIVEN))
