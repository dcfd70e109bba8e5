import threading
from pathlib import Path

import pytest
import torch

from frida_painter.errors import RobotError, StorageError
from frida_painter.runs.run import RunOutcome
from frida_painter.session.events import Finished, Paused, ResultFound, Scheduled, Stopped, StrokePainted
from frida_painter.session.journal import Journal
from frida_painter.session.progress import Painting
from frida_painter_cli.leading import follow, tell
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


@pytest.mark.parametrize("inside", ["", "painting"])
def test_a_painting_is_followed_until_its_painter_ends(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], inside: str
) -> None:
    (tmp_path / inside).mkdir(exist_ok=True)
    journal = Journal.begin(tmp_path / inside, {}, {})
    journal.show(Scheduled(0, 3))

    def paint() -> None:
        for done in (1, 2, 3):
            journal.tell(StrokePainted(done, 3))
        journal.show(Paused("You asked.", 3, "person"))
        journal.tell(Finished(3))
        journal.show(ResultFound("results"))
        journal.close()

    painter = threading.Timer(0.3, paint)
    painter.start()
    follow(tmp_path)
    painter.join()
    assert capsys.readouterr().out == "3 of 3 strokes painted. It finished.\n"


def test_what_is_no_painting_is_not_followed_and_one_that_ended_is_told(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(StorageError):
        follow(tmp_path)
    journal = Journal.begin(tmp_path, {}, {})
    journal.tell(StrokePainted(2, 3))
    journal.show(Stopped())
    journal.close()
    follow(tmp_path)
    assert capsys.readouterr().out == "2 of 3 strokes painted. It stopped.\n"
