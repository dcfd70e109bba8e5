"""The table of behaviours against firmware that was built from its own sources.

Skipped unless FRIDA_REAL_GRBL or FRIDA_REAL_MARLIN names a program that was built as docs/lab/real-firmware.md says.
"""

import os
from collections.abc import Callable, Iterator

import pytest

from frida_painter.hardware.gcode import Servo
from hardware.test_behaviours import *  # noqa: F403
from hardware.test_foretold import paint_as_foretold
from machines.bench import SERVO_GRBL, SERVO_MARLIN, Bench, SerialBench
from machines.real_firmware import real_grbl, real_marlin
from machines.simulated_time import SimulatedTime

GRBL, MARLIN, MARLIN_SERVO = (os.environ.get(f"FRIDA_REAL_{name}", "") for name in ("GRBL", "MARLIN", "MARLIN_SERVO"))
if not (GRBL or MARLIN or MARLIN_SERVO):
    pytest.skip("no real firmware was built here", allow_module_level=True)

LIMITS = ("$21=1",)
QUICK = ("$1=255", "$110=8000", "$111=8000", "$112=3000", "$120=500", "$121=500", "$122=200", *LIMITS)
WIDE = ("M211 S0",)
REAL: dict[str, Callable[[SimulatedTime], SerialBench]] = {
    "GRBL as it comes": lambda clock: real_grbl(clock, GRBL, LIMITS),
    "GRBL set up": lambda clock: real_grbl(clock, GRBL, QUICK),
    "GRBL in inches": lambda clock: real_grbl(clock, GRBL, (*QUICK, "$13=1", "$10=0")),
    "GRBL, servo, laser mode": lambda clock: real_grbl(clock, GRBL, (*QUICK, "$32=1"), SERVO_GRBL),
    "GRBL, servo, no laser mode": lambda clock: real_grbl(clock, GRBL, QUICK, SERVO_GRBL),
    "Marlin": lambda clock: real_marlin(clock, MARLIN, WIDE),
    "Marlin, servo": lambda clock: real_marlin(clock, MARLIN_SERVO, WIDE, SERVO_MARLIN),
}


def is_named(name: str) -> bool:
    """True if the program of this column was built here."""
    return bool({"Marlin": MARLIN, "Marlin, servo": MARLIN_SERVO}.get(name, GRBL))


@pytest.fixture(params=filter(is_named, REAL))
def bench(request: pytest.FixtureRequest, simulated_time: SimulatedTime) -> Iterator[Bench]:
    made = REAL[request.param](simulated_time)
    yield made
    made.controller.end()


HIGH_GRBL, HIGH_MARLIN = Servo((-0.01, 100), (0.11, 900)), Servo((-0.01, 10), (0.11, 150))
FORETOLD: dict[str, Callable[[SimulatedTime], SerialBench]] = {
    **{name: REAL[name] for name in ("GRBL as it comes", "GRBL set up", "Marlin")},
    "GRBL, servo, laser mode": lambda clock: real_grbl(clock, GRBL, (*QUICK, "$32=1"), HIGH_GRBL),
    "GRBL, servo, no laser mode": lambda clock: real_grbl(clock, GRBL, QUICK, HIGH_GRBL),
    "Marlin, servo": lambda clock: real_marlin(clock, MARLIN_SERVO, WIDE, HIGH_MARLIN),
}


@pytest.mark.parametrize("name", filter(is_named, FORETOLD))
def test_the_time_of_a_plan_was_foretold_within_5_percent(simulated_time: SimulatedTime, name: str) -> None:
    made = FORETOLD[name](simulated_time)
    try:
        paint_as_foretold(simulated_time, made, name, 8)
    finally:
        made.controller.end()
