import itertools
import json
import shlex
from pathlib import Path

import pytest
import torch
from hypothesis import assume, given
from hypothesis import strategies as st

from frida_painter.canvas_size import CanvasSize
from frida_painter.errors import ConfigError, PlanError
from frida_painter.runs.spec import RunSpec
from frida_painter.strokes.palette import Palette
from frida_painter.strokes.plan import Plan
from frida_painter.strokes.strokes import StrokeLimits, Strokes
from frida_painter.system import images
from frida_painter_cli.tiling import cut, deal, divide, plan_of, tiles_of
from support.commandline import run_command

LIMITS = StrokeLimits((0.01, 0.08), (-0.03, 0.03))
millimetres = st.integers(30, 900).map(lambda number: number / 1000)


@given(millimetres, millimetres, st.floats(0, 0.95))
def test_tiles_of_a_side_cover_it_evenly_and_are_as_few_as_possible(whole: float, tile: float, share: float) -> None:
    overlap = share * tile
    spans = divide(whole, tile, overlap)
    assert spans[0][0] == 0 and spans[-1][1] == pytest.approx(whole)
    assert all(end - begin == pytest.approx(min(tile, whole)) for begin, end in spans)
    laps = [before[1] - after[0] for before, after in itertools.pairwise(spans)]
    assert all(lap >= overlap - 1e-9 and lap == pytest.approx(laps[0]) for lap in laps)
    fewer = len(spans) - 1
    assert fewer == 0 or fewer * tile - (fewer - 1) * overlap < whole + 1e-9
    shown = cut(spans)
    assert sum(end - begin for begin, end in shown) == pytest.approx(whole)
    assert all(of[0] <= part[0] <= part[1] <= of[1] + 1e-9 for of, part in zip(spans, shown, strict=True))


@pytest.mark.parametrize("overlap", [-0.01, 0.1, 0.2, float("nan")])
def test_an_overlap_that_no_tile_can_have_is_refused(overlap: float) -> None:
    with pytest.raises(ConfigError):
        divide(1.0, 0.1, overlap)
    with pytest.raises(ConfigError, match="at most"):
        tiles_of(CanvasSize(3, 3), CanvasSize(0.1, 0.1), 0.05)


def some_plan(count: int, seed: int, canvas: CanvasSize) -> Plan:
    """Strokes anywhere on a canvas, as a planner makes them: wholly on it."""
    generator = torch.Generator().manual_seed(seed)
    share = torch.rand(7, count, generator=generator)
    position = torch.stack((share[0] * canvas.width, share[1] * canvas.height), 1)
    paint = (2 * share[6]).long()
    palette = Palette(torch.tensor([[0.9, 0.8, 0.7], [0.1, 0.2, 0.3]]))
    strokes = Strokes(position, 7 * share[2], 0.08 * share[3], 0.06 * share[4] - 0.03, share[5], palette.color[paint])
    strokes = strokes.project(LIMITS, canvas)
    return Plan.of(strokes, palette, paint, brush="fine", limits=LIMITS, canvas=canvas)


@given(st.integers(1, 40), st.integers(0, 2**31), st.integers(100, 250), st.integers(0, 60), st.booleans())
def test_each_stroke_is_on_the_tiles_that_show_and_hold_it(
    count: int, seed: int, wide: int, overlap: int, once: bool
) -> None:
    canvas = CanvasSize(0.4, 0.3)
    plan, tiles = some_plan(count, seed, canvas), tiles_of(canvas, CanvasSize(wide / 1000, 0.16), overlap / 1000)
    assume(len(tiles) > 1)
    points, widths = plan.strokes.path(torch.linspace(0, 1, 200)), torch.full((count,), 0.004)
    reach = plan.strokes.extremes()
    extent = float((reach.amax(1) - reach.amin(1)).max())
    try:
        dealt, ends = deal(plan, tiles, widths, once=once)
    except PlanError:
        assert extent > overlap / 1000 - 1e-6, "a stroke that is no longer than the overlap fits on a tile"
        return
    found = torch.zeros(count, dtype=torch.int)
    for tile, which in zip(tiles, dealt, strict=True):
        part = plan_of(plan, tile, which)  # a plan checks that each path lies on its canvas
        found[which] += 1
        corner = torch.tensor([tile.x[0], tile.y[0]])
        assert torch.allclose(part.strokes.position + corner, plan.strokes.position[which], atol=1e-6)
        assert torch.equal(part.paint, plan.paint[which]) and which == sorted(which)
        if not once and ends == 0:
            x, y = points.unbind(-1)
            is_seen = (x > tile.shown_x[0]) & (x < tile.shown_x[1]) & (y > tile.shown_y[0]) & (y < tile.shown_y[1])
            assert {*is_seen.any(1).nonzero().flatten().tolist()} <= {*which}
    assert bool((found == 1).all() if once else (found >= 1).all())
    if overlap / 1000 >= 2 * (extent + 0.004):
        assert ends == 0


def test_a_picture_on_two_sheets_is_painted_and_joined(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    photo = torch.zeros(3, 40, 80)
    photo[0, :, :40], photo[2, :, 40:] = 0.9, 0.9
    images.save(photo, Path("photo.png"))
    small = ("--strokes", 16, "--colors", 3, "--effort", 0.05, "--render-height", 64, "--ground", "white")
    assert run_command("plan", "photo.png", "--canvas", "20x10cm", *small, "--out", "whole") == 0
    assert run_command("tiles", "whole", "--sheet", "20x5.1cm", "--overlap", 2, "--out", "few") == 2
    assert "--overlap" in capsys.readouterr().err and not Path("few").exists()
    assert run_command("tiles", "whole", "--sheet", "15x10cm", "--overlap", 100, "--out", "both") == 0
    commands = [
        line.partition(" strokes: ")[2] for line in capsys.readouterr().out.splitlines() if " strokes: " in line
    ]
    plans = [Plan.load(Path("both", name)) for name in ("A1", "B1")]
    assert [str(plan.canvas) for plan in plans] == ["150 x 100 mm"] * 2
    assert all(torch.equal(plan.palette.color, Plan.load("whole").palette.color) for plan in plans)
    assert run_command("render", "both", "--height", 100, "--out", "planned.png") == 0
    for command in commands:
        assert run_command(*shlex.split(command)[1:], "--no-film", "--replans", 0) == 0
    assert RunSpec.read(Path("both/B1/painting/settings.json")).heading == "Photo, B1"
    assert run_command("render", "both", "--height", 100, "--out", "joined.png") == 0
    assert "A1, B1" in capsys.readouterr().out
    joined, planned = images.load("joined.png"), images.load("planned.png")
    assert joined.shape == planned.shape == (3, 100, 200)
    left, right = joined[:, :, :90].mean((1, 2)), joined[:, :, 110:].mean((1, 2))
    assert left[0] > left[2] and right[2] > right[0]
    assert (joined - planned).square().mean() < 0.02, "it is painted as it was planned"
    kept = json.loads(Path("both/tiles.json").read_text())
    Path("both/tiles.json").write_text(json.dumps(kept | {"once": True}))
    assert run_command("render", "both") == 2
