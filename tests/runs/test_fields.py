import math

import pytest

from frida_painter.errors import ConfigError
from frida_painter.runs.fields import millimetres_and_degrees


@pytest.mark.parametrize(
    ("text", "shift", "degrees"),
    [
        ("4mm,2deg", (0.004, 0.0), 2.0),
        ("3mm,-2mm,-1.5deg", (0.003, -0.002), -1.5),
        (" .5mm , 0mm , 0deg ", (0.0005, 0.0), 0.0),
        ("4MM,2DEG", (0.004, 0.0), 2.0),
    ],
)
def test_what_is_understood(text: str, shift: tuple[float, float], degrees: float) -> None:
    error = millimetres_and_degrees(text)
    assert error is not None
    assert error[:2] == pytest.approx(shift) and error[2] == pytest.approx(math.radians(degrees))


def test_nothing_given_is_left_to_the_seed() -> None:
    assert millimetres_and_degrees(None) is None


@pytest.mark.parametrize("text", ["", "4,2", "4mm", "2deg", "4mm,2mm", "nanmm,2deg", "4cm,2deg", "1mm,1mm,1mm,1deg"])
def test_what_is_not_understood_is_told_what_would_be(text: str) -> None:
    with pytest.raises(ConfigError, match="4mm,2deg"):
        millimetres_and_degrees(text)


@pytest.mark.parametrize("text", ["60mm,0deg", "1mm,20deg", "40mm,40mm,0deg"])
def test_what_cannot_be_corrected_is_refused(text: str) -> None:
    with pytest.raises(ConfigError, match="at most 50 mm and 15 degrees"):
        millimetres_and_degrees(text)
