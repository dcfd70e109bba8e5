import math
import re

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from frida_painter.canvas_size import CanvasSize
from frida_painter.errors import ConfigError
from frida_painter.frames import MapFrame, PixelGrid, Rows, pixel_to_map, pixel_to_map_plainly, wrap_angles
from frida_painter.render.reference import composite

SIDES = st.floats(0.03, 3)
SIZES = st.builds(CanvasSize, SIDES, SIDES)
GRIDS = st.builds(PixelGrid, SIZES, st.integers(1, 500), st.integers(1, 500))
SHARES = st.tuples(st.floats(0, 1), st.floats(0, 1))


@pytest.mark.parametrize(
    ("text", "width", "height"),
    [
        ("14x11in", 0.3556, 0.2794),
        (" 297 x 210 MM ", 0.297, 0.21),
        ("40×30cm", 0.4, 0.3),
        ("1x.5m", 1, 0.5),
        ("8.5x11in", 0.2159, 0.2794),
        ("30 x 40 cm", 0.3, 0.4),
        ("11,5x14 in", 0.2921, 0.3556),
        ('12×16"', 0.3048, 0.4064),
        ("12″ x 16″", 0.3048, 0.4064),
        ("12\u00a0×\u00a016\u00a0inches", 0.3048, 0.4064),
        ("12 in. by 16 in.", 0.3048, 0.4064),
        ("300mm x 400mm", 0.3, 0.4),
        ("30cm x 12in", 0.3, 0.3048),
        ("30cm x 40", 0.3, 0.4),
        ("8 1/2 x 11 in", 0.2159, 0.2794),
        ("8½x11in", 0.2159, 0.2794),
        ("1' x 1.5 feet", 0.3048, 0.4572),
        ("３０×４０cm", 0.3, 0.4),
        ("30*40 centimetres", 0.3, 0.4),
        ("A5", 0.148, 0.21),
        ("a4", 0.21, 0.297),
        ("A3 landscape", 0.42, 0.297),
        ("portrait A2", 0.42, 0.594),
        ("A4 (Landscape)", 0.297, 0.21),
        ("Letter", 0.2159, 0.2794),
        ("tabloid, landscape", 0.4318, 0.2794),
        ("ledger", 0.4318, 0.2794),
        ("30x40cm landscape", 0.4, 0.3),
    ],
)
def test_sizes_as_people_write_them(text: str, width: float, height: float) -> None:
    size = CanvasSize.parse(text)
    assert (size.width, size.height) == (pytest.approx(width), pytest.approx(height))


@pytest.mark.parametrize(
    ("text", "says"),
    [
        *((text, "is not understood; give width x height with a unit, or a name") for text in (
            "", "-14x11in", "nanxnanmm", "infxinfmm", "1e9x1mm", "x1mm", "30 40 cm", "30x40x50cm", "A9", "letters",
            "landscape", "30x40parsec", "0/0x1in", "1/0x5in",
        )),
        ("14", "names one side; .* a square is 14 x 14 cm"),
        ("40cm", "names one side; .* a square is 40 x 40 cm"),
        ("14x11", "has no unit; write which one it is .14x11in, 14x11cm, 14x11mm."),
        ("landscape portrait A4", "landscape and portrait"),
    ],
)  # fmt: skip
def test_sizes_that_are_not_understood_say_what_to_write(text: str, says: str) -> None:
    with pytest.raises(ConfigError, match=says) as refused:
        CanvasSize.parse(text)
    assert "for example 14x11in" in str(refused.value) or "give one of them" in str(refused.value)


@given(SIZES, st.sampled_from(["mm", "cm", "m", "in", "inches", '"', "ft"]), st.sampled_from(["x", " × ", " by "]))
def test_a_size_is_read_in_whatever_unit_it_is_written(size: CanvasSize, unit: str, between: str) -> None:
    of = {"mm": 0.001, "cm": 0.01, "m": 1, "ft": 0.3048}.get(unit, 0.0254)
    width, height = (f"{metres / of:.6f}" for metres in (size.width, size.height))
    for comma in (".", ","):
        try:
            read = CanvasSize.parse(f"{width}{between}{height} {unit}".replace(".", comma))
        except ConfigError:  # rounded to just outside
            assert min(size.width, size.height) < 0.030001 or max(size.width, size.height) > 2.99999
            continue
        assert (read.width, read.height) == (pytest.approx(size.width, abs=1e-6), pytest.approx(size.height, abs=1e-6))


@given(st.text(max_size=30))
def test_any_text_is_a_size_or_refused(text: str) -> None:
    try:
        CanvasSize.parse(text)
    except ConfigError as refused:
        assert str(refused).endswith(".")


@pytest.mark.parametrize(("rows", "columns"), [(10, 400), (400, 10), (30, 1000), (1000, 13), (16, 1600), (3000, 16)])
def test_a_picture_too_long_for_the_canvas_is_told_so_with_a_canvas_that_would_do(rows: int, columns: int) -> None:
    with pytest.raises(ConfigError) as refused:
        CanvasSize.parse("14x11in").orient_like(rows, columns).crop_like(rows, columns)
    told = str(refused.value)
    share = max(rows, columns) / min(rows, columns)
    assert told.startswith(
        f"The picture is {share:.3g} times as {'wide as high' if columns > rows else 'high as wide'}"
    )
    assert "give --fit crop or --fit pad" in told and "was given" not in told
    advised = re.search(r"--canvas (\S+mm)", told)
    assert (advised is not None) == (share < 98)
    if advised is not None:
        found = CanvasSize.parse(advised[1]).crop_like(rows, columns)
        assert found.width / found.height == pytest.approx(columns / rows)


@pytest.mark.parametrize("text", ["0x0mm", "100x100m", "29x100mm", "100x29mm", "3001x100mm"])
def test_sizes_that_are_too_small_or_too_large(text: str) -> None:
    with pytest.raises(ConfigError, match="each side is from 30 to 3000 mm"):
        CanvasSize.parse(text)


def test_sizes_that_are_not_numbers() -> None:
    for wrong in (math.nan, math.inf, -0.3):
        with pytest.raises(ConfigError):
            CanvasSize(0.3, wrong)


def test_a_canvas_is_turned_like_its_picture() -> None:
    wide, tall = CanvasSize(0.4, 0.3), CanvasSize(0.3, 0.4)
    assert wide.orient_like(100, 200) == wide == tall.orient_like(100, 200)
    assert wide.orient_like(200, 100) == tall == tall.orient_like(200, 100)


@given(GRIDS, SHARES)
def test_pixels_and_metres_are_each_others_inverse(grid: PixelGrid, share: tuple[float, float]) -> None:
    corner = torch.tensor([grid.size.width, grid.size.height], dtype=torch.float64)
    position = torch.tensor(share, dtype=torch.float64) * corner
    assert torch.allclose(grid.to_canvas(grid.to_pixels(position)), position, atol=1e-12)


@given(GRIDS)
def test_the_picture_shows_exactly_the_canvas_and_y_goes_up(grid: PixelGrid) -> None:
    corners = torch.tensor([[0.0, grid.size.height], [grid.size.width, 0.0]], dtype=torch.float64)
    top_left, bottom_right = grid.to_pixels(corners)
    assert torch.allclose(top_left, top_left.new_tensor([-0.5, -0.5]), atol=1e-9)
    assert torch.allclose(bottom_right, bottom_right.new_tensor([grid.columns - 0.5, grid.rows - 0.5]), atol=1e-9)


@given(SIZES, SHARES)
def test_pages_count_from_the_top_left_corner(size: CanvasSize, share: tuple[float, float]) -> None:
    position = torch.tensor(share, dtype=torch.float64) * torch.tensor([size.width, size.height], dtype=torch.float64)
    grid = PixelGrid(size, 1, 1)
    across = (grid.to_pixels(position) + 0.5) * torch.tensor(grid.pitch, dtype=torch.float64)
    assert torch.allclose(size.on_page(position), across, atol=1e-12)


@given(SIZES, st.integers(16, 1000))
def test_pixels_are_as_square_as_whole_numbers_allow(size: CanvasSize, rows: int) -> None:
    grid = PixelGrid.of_height(size, rows)
    assert grid.rows == rows
    assert grid.columns == 1 or abs(grid.columns - rows * size.width / size.height) <= 0.5


@given(GRIDS, SHARES, st.floats(-10, 10), st.integers(0, 2**31))
def test_pixel_to_map_undoes_turning_and_moving(
    grid: PixelGrid, share: tuple[float, float], angle: float, seed: int
) -> None:
    frame = MapFrame(-0.01, 0.07, -0.02, 0.03, 24, 64)
    position = torch.tensor(share, dtype=torch.float64) * torch.tensor([grid.size.width, grid.size.height])
    turn = torch.tensor([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]], dtype=torch.float64)
    # Cell centres of the map, carried onto the canvas by hand and from there into pixels ...
    pixel = grid.to_pixels(frame.cell_centers(dtype=torch.float64) @ turn.T + position)  # [rows, columns, 2]
    affine = pixel_to_map(position[None], torch.tensor([angle], dtype=torch.float64), grid, frame)[0]
    cell = pixel @ affine[:, :2].T + affine[:, 2]
    # ... must come back to the cells they were.
    row, column = torch.meshgrid(torch.arange(24.0), torch.arange(64.0), indexing="ij")
    assert torch.allclose(cell, torch.stack((column, row), -1).double(), atol=1e-6)


@pytest.mark.parametrize("rows", [Rows(), Rows(3, 2)], ids=["all", "some"])
def test_the_derivatives_of_pixel_to_map_are_those_of_its_values(rows: Rows) -> None:
    grid, frame = PixelGrid(CanvasSize(0.3, 0.2), 40, 61), MapFrame(-0.02, 0.09, -0.03, 0.04, 20, 31)
    chance = torch.Generator().manual_seed(0)
    position, angle = (
        scale * torch.rand(*shape, generator=chance).double() for scale, shape in ((20, (5, 2)), (7, (5,)))
    )
    leaves = position.requires_grad_(), angle.requires_grad_()
    assert torch.autograd.gradcheck(lambda at, turn: pixel_to_map(at / 100, turn, grid, frame, rows), leaves)


@given(GRIDS, st.integers(1, 20), st.integers(0, 2**31), st.sampled_from((torch.float64, torch.float32)))
def test_compiled_pixel_to_map_is_the_plain_one(grid: PixelGrid, count: int, seed: int, dtype: torch.dtype) -> None:
    frame, rows, chance = MapFrame(-0.02, 0.09, -0.03, 0.04, 20, 31), Rows(3, 2), torch.Generator().manual_seed(seed)
    position, angle = (
        torch.rand(count, 2, generator=chance, dtype=dtype),
        torch.randn(count, generator=chance).to(dtype),
    )
    upstream = torch.randn(count, 2, 3, generator=chance).to(dtype)
    found = []
    for place in (pixel_to_map, pixel_to_map_plainly):
        leaves = position.clone().requires_grad_(), angle.clone().requires_grad_()
        affine = place(*leaves, grid, frame, rows)
        found.append((affine.detach(), *torch.autograd.grad((affine * upstream).sum(), leaves)))
    for one, other in zip(*found, strict=True):
        largest = float(other.abs().amax())
        torch.testing.assert_close(one, other, rtol=0, atol=(1e-12 if dtype == torch.float64 else 1e-5) * largest)


@given(GRIDS, SHARES, st.floats(-10, 10), st.integers(1, 20), st.integers(0, 19))
def test_some_rows_of_a_grid_lie_where_they_lie_among_all(
    grid: PixelGrid, share: tuple[float, float], angle: float, every: int, first: int
) -> None:
    frame, rows = MapFrame(-0.01, 0.07, -0.02, 0.03, 24, 64), Rows(every, first)
    position = torch.tensor([share], dtype=torch.float64) * torch.tensor([grid.size.width, grid.size.height])
    turn = torch.tensor([angle], dtype=torch.float64)
    whole, some = pixel_to_map(position, turn, grid, frame)[0], pixel_to_map(position, turn, grid, frame, rows)[0]
    numbers = torch.arange(first + 3 * every, dtype=torch.float64)
    mine, theirs = rows.of(numbers[:, None])[:, 0], torch.arange(3, dtype=torch.float64)
    assert mine.tolist() == [first, first + every, first + 2 * every]
    for column in (0.0, 7.0):
        at = whole[:, :1] * column + whole[:, 1:2] * mine + whole[:, 2:]
        torch.testing.assert_close(some[:, :1] * column + some[:, 1:2] * theirs + some[:, 2:], at, rtol=0, atol=1e-6)


def test_a_resized_map_lies_where_it_lay() -> None:
    frame = MapFrame(-0.01, 0.07, -0.02, 0.03, 24, 64)
    large = frame.resize(48, 128)
    assert large.pitch == pytest.approx((frame.pitch[0] / 2, frame.pitch[1] / 2))
    quads = large.cell_centers(dtype=torch.float64).reshape(24, 2, 64, 2, 2).mean((1, 3))
    assert torch.allclose(quads, frame.cell_centers(dtype=torch.float64), atol=1e-12)


@given(st.floats(-1e3, 1e3))
def test_whole_turns_are_removed(angle: float) -> None:
    turned = wrap_angles(torch.tensor(angle, dtype=torch.float64))
    assert -math.pi <= turned < math.pi
    assert math.cos(turned) == pytest.approx(math.cos(angle), abs=1e-9)
    assert math.sin(turned) == pytest.approx(math.sin(angle), abs=1e-9)


def test_an_f_stays_an_f() -> None:
    """An F as a magnitude map must look on the canvas as it looks in the map: neither mirrored nor turned."""
    letter = torch.zeros(7, 5, dtype=torch.float64)
    letter[1:6, 1] = letter[1, 1:4] = letter[3, 1:3] = 1
    size = CanvasSize(0.05, 0.07)
    frame = MapFrame(0, 0.05, 0, 0.07, 7, 5)
    origin, angle = torch.zeros(1, 2, dtype=torch.float64), torch.zeros(1, dtype=torch.float64)
    ink = torch.zeros(1, 3, dtype=torch.float64)
    paper = torch.ones(3, 7, 5, dtype=torch.float64)
    picture = composite(letter[None], pixel_to_map(origin, angle, PixelGrid(size, 7, 5), frame), ink, paper)
    assert torch.allclose(picture[0], 1 - letter, atol=1e-9)
    # Turned by a quarter to the left, its stem lies flat and its arms point up (numpy's rot90).
    moved = torch.tensor([[0.07, 0.0]], dtype=torch.float64)
    grid = PixelGrid(CanvasSize(0.07, 0.05), 5, 7)
    picture = composite(
        letter[None], pixel_to_map(moved, angle + math.pi / 2, grid, frame), ink, paper.new_ones(3, 5, 7)
    )
    assert torch.allclose(picture[0], 1 - torch.rot90(letter), atol=1e-9)


def test_a_size_is_itself_or_what_its_text_says() -> None:
    size = CanvasSize(0.3, 0.2)
    assert CanvasSize.of(size) is size
    assert CanvasSize.of("30x20cm") == size
    with pytest.raises(ConfigError, match="not understood"):
        CanvasSize.of("large")
