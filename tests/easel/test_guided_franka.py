"""A Franka that a person guides with the buttons at its hand: franky reads its tip while it is led."""

import time
import tomllib
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("franky")
pytest.importorskip("franky_sim")

from frida_painter.easel import connecting
from frida_painter.easel.connecting import guide_arm
from frida_painter.errors import MotionFailed, RobotError
from frida_painter.hardware.latch import latches
from frida_painter.hardware.workcell import WorkcellConfig, example
from frida_painter_drivers.franka import FrankaReach
from machines.franky_arm import BRUSH, FrankyArm, tip_positions


def test_the_tip_of_a_guided_franka_is_recorded_and_nothing_moves_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(connecting, "state_folder", lambda: tmp_path / "state")
    workcell = WorkcellConfig.of(tomllib.loads(example()), "example")
    along = np.linspace(0, 1, 800)
    places = np.c_[0.42 + 0.08 * along, 0.05 * np.sin(5 * along), 0.15 - 0.03 * np.sin(np.pi * along)]
    joints = FrankaReach(BRUSH).solve(places)
    joints.tofile(tmp_path / "led.bin")
    truth = tip_positions(joints)
    tips: list[np.ndarray] = []
    with FrankyArm(tmp_path, table=False, start=joints[0].tolist()) as arm:
        name = f"franka:{arm.address},brush_length={BRUSH}"

        def hear(tip: np.ndarray, at: float) -> None:
            if not tips:
                arm.order(mode="kGuiding", guide=str(tmp_path / "led.bin"))
            tips.append(tip)

        until = time.monotonic() + 300
        guide_arm(
            name,
            workcell,
            hear,
            lambda: bool(tips) and (np.linalg.norm(tips[-1] - truth[-1]) < 1e-3 or time.monotonic() > until),
        )
        assert arm.moves() == 0 and arm.recoveries() == 0
        away = np.linalg.norm(np.array(tips)[:, None] - truth[None], axis=2)
        assert away.min(1).max() < 5e-4 and len(set(away.argmin(1).tolist())) > 20
        assert away.min(1)[-1] < 1e-3 and away[-1].argmin() > 780
        (latch,) = latches(tmp_path / "state")
        latch.release()
        for mode, error, words in (
            ("kReflex", MotionFailed, "guide: .*ran into something"),
            ("kMove", RobotError, "guide: .*another program moves it"),
        ):
            arm.order(mode=mode, errors=[])
            with pytest.raises(error, match=words):
                guide_arm(name, workcell, hear, lambda: True)
            (latch,) = latches(tmp_path / "state")
            latch.release()
