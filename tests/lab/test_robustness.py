import json
from unittest.mock import MagicMock

import pytest
import torch

from frida_painter import images
from frida_painter.errors import CalibrationError
from frida_painter.lab import robustness
from frida_painter.lab.robustness import Case, robustness_sheet


@pytest.mark.slow
def test_every_case_of_the_issue_is_survived_detected_or_refused(tmp_path):
    told = []
    outcome = robustness.run(brush="broad", scale=robustness.QUICK, notify=told.append)
    rows = {row["what goes wrong"]: row for row in outcome.tables[0].rows}
    assert [row["outcome"] for row in rows.values()] == [
        "detected", "survived", "detected", "survived", "refused", "survived", "survived",
    ]  # fmt: skip
    assert "silently wrong model" in outcome.notes[0] and "none" in outcome.notes[0]
    assert "out of focus" in rows["the camera loses focus for good"]["said"]
    dots = rows["two of the 16 dots are missing"]
    assert dots["disturbed"] < 0.5 and dots["as if nothing had been told"] > 4
    checker = rows["the checker is rotated by 180 degrees"]
    assert checker["disturbed"] < 2.5
    assert 0 <= told[0].share <= told[-1].share < 1
    outcome.save(tmp_path)
    assert json.loads((tmp_path / "table.json").read_text())["experiment"] == "robustness"
    assert images.load(tmp_path / "robustness.png").shape[2] == 1500


def case(**changes):
    plain = {
        "what": "it rains", "outcome": "survived", "figure": "wetness", "undisturbed": 1.0, "disturbed": 1.1,
        "untold": 3.0, "said": "Bring an umbrella. " * 30, "harmless": True,
    }  # fmt: skip
    return Case(**{**plain, **changes})


def test_a_silently_wrong_case_stands_out_on_the_sheet():
    fine, wrong = (robustness_sheet("Weather", [case(harmless=harmless)]) for harmless in (True, False))
    assert fine.shape == wrong.shape and (fine - wrong).abs().max() > 0.3


def test_a_refusal_without_the_fault_is_told_from_one_with_it(monkeypatch):
    """The second is what was hoped for; after the first, nothing is known of the fault."""
    finding = type("Finding", (), {"held_out": torch.ones(2), "photographed": torch.ones(2), "sentence": "Found."})
    refusal = CalibrationError("No checker.")
    monkeypatch.setattr(robustness, "_studio", lambda *easel: MagicMock())
    for outcomes, undisturbed, harmless in (([refusal], None, False), ([finding, refusal], 1.0, True)):
        left = iter(outcomes)
        monkeypatch.setattr(robustness, "_attempt", lambda calibrate, left=left: next(left))
        found = robustness._checker("broad", 0)
        assert (found.outcome, found.undisturbed, found.disturbed) == ("refused", undisturbed, None)
        assert found.harmless == harmless and ("without the fault" in found.said) != harmless
        assert "No checker." in found.said and robustness_sheet("Weather", [found, case()]).shape[0] == 3


def test_a_case_without_figures_is_drawn_too():
    refused = case(outcome="refused", undisturbed=None, disturbed=None, untold=None)
    assert robustness_sheet("Weather", [refused, case()]).shape[0] == 3


def test_a_figure_that_is_much_worse_than_undisturbed_is_called_wrong():
    judge = robustness._case
    assert judge("x", "survived", "placement, mm", 0.2, 0.25, None, "").harmless
    assert not judge("x", "survived", "placement, mm", 0.2, 0.9, None, "").harmless
    assert not judge("x", "survived", "placement, mm", 0.2, float("nan"), None, "").harmless
