from pathlib import Path

import pytest
import torch

from frida_painter import images
from frida_painter.cli import commands
from frida_painter.errors import ConfigError, WorkerUnfit
from frida_painter.lab.benchmark import cell, judges
from frida_painter.lab.benchmark.cell import ENTRANTS, BenchmarkCell, CellAssignment, perform_cell
from frida_painter.lab.benchmark.judges import Judges, ssim
from frida_painter.lab.benchmark.suite import Budget
from frida_painter.provenance import identify_here

STROKES = """# frida-painter strokes 1
stroke,color,width_mm,x_mm,y_mm
1,#204080,15,10,20
1,#204080,15,60,20
2,#a03020,10,20,40
2,#a03020,10,60,45
"""


@pytest.fixture
def small(tmp_path, monkeypatch) -> Path:
    """A folder with a picture of its own and strokes for it; its canvas is small."""
    monkeypatch.setattr("frida_painter.lab.benchmark.suite._LONG", 0.08)
    picture = torch.ones(3, 48, 64)
    picture[:, 24:] = torch.tensor([0.1, 0.25, 0.5])[:, None, None]
    images.save(picture, tmp_path / "own.png")
    (tmp_path / "strokes.csv").write_text(STROKES)
    return tmp_path


def of(folder: Path, **changes) -> BenchmarkCell:
    values = {"entrant": "peer", "goal": str(folder / "own.png"), "strokes": 100, "seed": 11,
              "hand_in": str(folder / "strokes.csv"), **changes}  # fmt: skip
    return BenchmarkCell(**values)


@pytest.mark.slow
def test_strokes_of_a_stranger_are_painted_and_judged(small, monkeypatch):
    made = perform_cell(CellAssignment(of(small, cpu_seconds=3.5), str(small), identify_here()))
    figures = made["figures"]
    assert 2 <= figures["strokes"] <= 4 and figures["paints"] == 2 and figures["CPU s"] == 3.5 and figures["dips"] >= 2
    assert 0 < figures["robot minutes"] < 60 and 5 < figures["PSNR, dB"] < 40 and figures["forecast, dB"] > 8
    painting = images.load(small / "runs" / made["key"] / "painting.png")
    row = round(painting.shape[1] * (1 - 20 / 60))
    blue = painting[:, row, painting.shape[2] // 2]
    assert blue[2] > blue[0] + 0.1, "the blue stroke lies 20 mm above the lower edge"
    monkeypatch.setattr(cell, "_paint", None)  # it would be called if the cell were painted again
    assert perform_cell(CellAssignment(of(small, cpu_seconds=3.5), str(small), identify_here())) == made
    if judges.PERCEPTUAL not in figures:
        monkeypatch.setattr(judges, "lacks_network", lambda known: True)
        monkeypatch.setattr(Judges, "of_picture", lambda self, truth, target: {judges.PERCEPTUAL: 0.25})
        again = perform_cell(CellAssignment(of(small, cpu_seconds=3.5), str(small), identify_here()))
        assert again["figures"] == {**figures, judges.PERCEPTUAL: 0.25}, "judged by the network that came later"


@pytest.mark.slow
def test_a_painting_ends_when_its_budget_is_used_up(small, monkeypatch):
    (small / "strokes.csv").write_text(
        STROKES + "".join(f"{n},#{n:02x}8040,8,{x},{10 + n}\n" for n in range(10, 30) for x in (10, 40))
    )
    monkeypatch.setattr(cell, "find_budget", lambda strokes: Budget(100, 12, 60.0, 4))
    made = perform_cell(CellAssignment(of(small), str(small), identify_here()))
    assert made["figures"]["dips"] == 4 and made["figures"]["strokes"] < 22


def test_other_machines_and_unknown_entrants_are_refused(small):
    with pytest.raises(WorkerUnfit, match=r"needs 0\.0 and"):
        perform_cell(CellAssignment(of(small), str(small), "0.0"))
    with pytest.raises(WorkerUnfit, match="does not see"):
        perform_cell(CellAssignment(of(small), str(small / "missing"), identify_here()))
    with pytest.raises(ConfigError, match="is no entrant"):
        of(small, hand_in=None).check()
    with pytest.raises(ConfigError, match="cannot be read as a hand-in"):
        perform_cell(CellAssignment(of(small, hand_in=str(small / "no.csv")), str(small), identify_here()))


def test_rivals_paint_photographs_alone(tmp_path):
    with pytest.raises(ConfigError, match="paints photographs alone"):
        perform_cell(CellAssignment(BenchmarkCell("plain", "rocket-and-dusk", 100, 11), str(tmp_path), identify_here()))


def test_similarity_has_its_laws():
    picture = torch.rand(3, 40, 50, generator=torch.Generator().manual_seed(0))
    noisy = (picture + 0.2 * torch.randn(3, 40, 50, generator=torch.Generator().manual_seed(1))).clamp(0, 1)
    assert ssim(picture, picture) == pytest.approx(1)
    assert ssim(noisy, picture) == pytest.approx(ssim(picture, noisy))
    assert ssim(noisy, picture) < 0.95
    judged = Judges(None).of_picture(noisy, picture)
    assert judged[judges.SSIM] == pytest.approx(ssim(noisy, picture)) and judges.PERCEPTUAL not in judged


def say(monkeypatch, capsys, *words: object) -> tuple[int, str, str]:
    monkeypatch.setattr("sys.argv", ["frida-painter", "benchmark", *map(str, words)])
    with pytest.raises(SystemExit) as end:
        commands.main()
    told = capsys.readouterr()
    return int(end.value.code or 0), told.out, told.err


def test_the_command_lists_the_suite(monkeypatch, capsys):
    status, out, _ = say(monkeypatch, capsys, "list")
    assert status == 0 and all(name in out for name in (*ENTRANTS, "astronaut", "boat-in-dusk", "1000 strokes"))


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (("judge", "strokes.csv", "--picture", "unicorn"), "'unicorn' is neither"),
        (("judge", "no.svg", "--picture", "cat"), "no.svg"),
        (("judge", "strokes.csv", "--picture", "cat", "--strokes", "200"), "budgets are 100, 300, 1000"),
        (("cell", "--entrant", "theirs", "--picture", "cat"), "is no entrant"),
        (("cell", "--entrant", "ours", "--picture", "cat", "--seed", "-1"), "seed"),
        (("table", "--pictures", "cat,cat"), "twice"),
        (("table", "--hand-in", "primitive"), "NAME=FOLDER"),
        (("table", "--hand-in", "primitive=missing", "--pictures", "cat"), "no folder of hand-ins"),
        (("page", "missing"), "missing"),
    ],
)
def test_wrong_commands_are_told_in_a_sentence(small, monkeypatch, capsys, words, told):
    monkeypatch.chdir(small)
    status, _, err = say(monkeypatch, capsys, *words)
    assert status == 2 and told in " ".join(err.split()) and "Traceback" not in err


def test_pictures_are_written_for_other_systems(small, monkeypatch, capsys):
    status, out, _ = say(monkeypatch, capsys, "pictures", small / "p", "--pictures", "cat", "--held-out", "7")
    assert status == 0 and (small / "p" / "cat-7.png").exists() and "mm" in out
