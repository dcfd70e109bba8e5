from pathlib import Path

import pytest
import torch

from frida_painter.cli.leading import tell
from frida_painter.errors import RobotError
from frida_painter.runs.run import RunOutcome
from frida_painter.session.progress import Painting
from support.plans import made_up_plan


@pytest.mark.parametrize(("left", "trouble"), [(0, None), (3, None), (0, RobotError("It stands still."))])
def test_what_was_left_out_for_time_is_finished_and_a_stopped_painting_can_go_on(
    left: int, trouble: RobotError | None, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rest = made_up_plan(5).part(slice(0, left))
    painting = Painting(torch.zeros(3, 4, 4), 8, rest)
    tell(RunOutcome(tmp_path, painting, tmp_path / "index.html", trouble), 20, 5.0)
    said = capsys.readouterr().out
    finished = left == 0 and trouble is None
    assert ("12 of 20 strokes were left out" in said) is finished and ("8 strokes in" in said) is finished
    assert ("Stopped after 8 of 20" in said) is not finished and ("frida-painter resume" in said) is not finished
