"""The programs that stress the painter still run, and find nothing in little time."""

from pathlib import Path
from types import ModuleType

import pytest

from support.programs import load_program


def program(name: str) -> ModuleType:
    return load_program(Path(__file__).parent / f"{name}.py")


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_a_few_hostile_command_lines_are_refused_in_order(tmp_path):
    # One of them begins an experiment, which on a busy machine is silent for a minute before its first figure.
    outcomes = list(program("hostile_commands").tried(tmp_path, 8, seed=1, seconds=240))
    assert [one.wrong for one in outcomes] == [""] * 8
    assert any(one.status == 2 for one in outcomes)


@pytest.mark.slow
def test_every_command_but_two_is_tried_with_all_that_it_takes():
    known = {one.path: one for one in program("hostile_commands").commands()}
    assert {("paint",), ("resume",), ("strokes", "train"), ("experiments", "replanning")} <= set(known)
    takes = {one.name: one.takes for one in known["paint",].parameters}
    assert takes["--brushes"] is str and takes["--settings"] is Path and takes["--strokes"] is int and takes[""] is Path


@pytest.mark.slow
def test_a_painting_that_is_killed_while_it_finishes_is_resumed_whole(tmp_path):
    (kill,) = program("kills").killed(tmp_path, 4, [0.85])
    assert (kill.wrong, kill.painted) == ("", 4)
