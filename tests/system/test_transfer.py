"""The watch over transfers: slow ones end, others are told."""

import pytest

from frida_painter.system.transfer import Transfer


class Clock:
    def __init__(self) -> None:
        self.now = 100.0

    def __call__(self) -> float:
        return self.now


def follow(speed: float, seconds: int, size: int | None = None, *, before: int = 0) -> tuple[int | None, list[str]]:
    """The second at which a transfer of a steady speed is ended, None if it is not, and what was told."""
    clock, told = Clock(), list[str]()
    transfer = Transfer("Fetched", size, told.append, clock)
    for second in range(seconds):
        clock.now = 100.0 + second
        if not transfer.hear(before + round(speed * second)):
            return second, told
    return None, told


@pytest.mark.parametrize(("speed", "ended"), [(0, 60), (1, 60), (1900, 60), (2100, None), (10**6, None)])
def test_one_that_hardly_moves_is_ended_after_a_minute(speed: float, ended: int | None) -> None:
    assert follow(speed, 600)[0] == ended


def test_what_was_here_before_is_no_speed() -> None:
    assert follow(10, 600, before=10**9)[0] == 60


def test_a_wait_before_the_first_bytes_is_no_speed() -> None:
    clock, told = Clock(), list[str]()
    transfer = Transfer("Fetched", 4 * 10**6, told.append, clock)
    for second, done in ((0, 0), (5, 0), (6, 16_384), (11, 16_384 + 5 * 10**5), (17, 10**6)):
        clock.now = 100.0 + second
        assert transfer.hear(done)
    assert "left" not in told[0] and all(sentence.endswith("about 1 min left.") for sentence in told[1:])


def test_it_is_told_ever_more_seldom() -> None:
    told = follow(10**6, 1800, 3 * 10**9)[1]
    assert told[0] == "Fetched 5 MB of 3000 MB, about 50 min left." and told[-1].endswith("about 21 min left.")
    assert 20 < len(told) < 50
    assert follow(10**6, 8)[1] == ["Fetched 5 MB."]
