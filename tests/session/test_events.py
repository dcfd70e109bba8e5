"""The one language of events: everything written is read again, also in the words of earlier versions."""

import json
import subprocess
import sys
from pathlib import Path
from typing import Any, get_args

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from frida_painter.errors import ConfigError
from frida_painter.session.events import (
    KINDS,
    Dipped,
    Failed,
    Finished,
    GoalChanged,
    Looked,
    MotionBegan,
    PaintingBegun,
    PaintingKept,
    PaintingStarted,
    Paused,
    Photographed,
    PlanAdopted,
    PlanningProgress,
    PlanPreview,
    PlanRequested,
    RegionProtected,
    SessionResumed,
    Stopped,
    StrokeLeftOut,
    StrokePainted,
    TimeLeft,
    WentOn,
    Written,
    events_of,
    record,
    time_of,
)
from frida_painter.session.journal import History, upgrade_journal
from frida_painter.web.commands import Kind, PaintingCommand, command

AT = "2026-01-02T03:04:05.678+00:00"
VALUES: dict[str, Any] = {
    "int": 3, "float": 0.25, "str": "words", "bool": True, "int | None": 3, "str | None": "a.jpg",
    "dict[str, Any]": {"a": [1]}, "dict[str, str]": {"a": "b"}, "dict[str, float]": {"a": 0.5},
    "tuple[float, ...]": (0.5,), "list[int]": [0, 2], "list[str]": ["canvas"],
    "list[dict[str, Any]]": [{"hex": "#000"}], "list[list[float]] | None": [[0.5]], "tuple[str, ...]": ("home",),
    "tuple[float, float, float]": (0.1, 0.2, 0.3), "tuple[tuple[float, ...], ...]": ((1.0, 0.0),),
}  # fmt: skip


@pytest.mark.parametrize("kind", sorted(KINDS))
def test_every_written_event_has_a_json_form(kind: str) -> None:
    event = KINDS[kind](**{field: VALUES[str(_plain(kinds))] for field, kinds in KINDS[kind].__annotations__.items()})
    written = record(event)
    assert written["kind"] == kind and time_of(written).tzinfo is not None
    assert events_of(json.loads(json.dumps(written, allow_nan=False))) == [event]


def _plain(annotation: Any) -> str:
    text = annotation if isinstance(annotation, str) else getattr(annotation, "__name__", str(annotation))
    text = str(annotation) if "[" in str(annotation) else text
    return text.replace("typing.", "")


def test_pixels_are_never_written() -> None:
    with pytest.raises(TypeError, match="Looked carries"):
        record(Looked(torch.zeros(3, 2, 2), torch.zeros(3, 2, 2), 1))  # type: ignore[arg-type]


OLD: list[tuple[dict[str, Any], list[Written]]] = [
    ({"kind": "begun", "settings": {"strokes": 6}, "rests_on": {}, "by": "a", "process": 1, "program": "0"},
     [PaintingBegun({"strokes": 6}, {}, "a", 1, "0")]),
    ({"kind": "begun", "plan": 1, "of": 4}, [PaintingStarted(1, 4)]),
    ({"kind": "resumed", "painted": 3, "in_doubt": 4, "decision": "skip", "by": "a", "process": 1, "program": "0"},
     [SessionResumed(3, 4, "skip", "a", 1, "0")]),
    ({"kind": "resumed"}, [WentOn()]),
    ({"kind": "planned", "plan": "f", "done": 2, "photograph": None,
      "placement": {"error": [0.0, 0.0, 0.1], "information": [[1.0]]}},
     [PlanAdopted("f", 2, None, (0.0, 0.0, 0.1), ((1.0,),))]),
    ({"kind": "looked", "photograph": "p.png", "captured_at": 1.5, "sequence": 2, "light": None},
     [Photographed("p.png", 1.5, 2, None)]),
    ({"kind": "began", "what": ["stroke 1"], "stroke": 1, "plan": "f"}, [MotionBegan(("stroke 1",), 1, "f")]),
    ({"kind": "ended", "stroke": 1}, [StrokePainted(1)]),
    ({"kind": "ended", "stroke": 2, "left_out": True}, [StrokeLeftOut(2)]),
    ({"kind": "ended", "paint": 2, "cleaned": True}, [Dipped(2, True)]),
    ({"kind": "paused", "reason": "Why.", "painted": 3}, [Paused("Why.", 3)]),
    ({"kind": "paused", "reason": "Why.", "turn": True}, [Paused("Why.", 0, True)]),
    ({"kind": "broken off", "reason": "Why."}, [Failed("Why.")]),
    ({"kind": "failed", "sentence": "Why."}, [Failed("Why.")]),
    ({"kind": "stopped", "painted": 3}, [Stopped(3)]),
    ({"kind": "stopped"}, [Stopped()]),
    ({"kind": "finished", "painted": 6}, [Finished(6)]),
    ({"kind": "finished", "film": True, "arm": False}, [PaintingKept(True)]),
    ({"kind": "protected", "region": "regions/1.png", "only": True}, [RegionProtected("regions/1.png", True)]),
    ({"kind": "redirected", "goal": "changes/1"}, [GoalChanged("changes/1", {})]),
    ({"kind": "wished", "plan": 1, "wish": {"seed": 2}}, [PlanRequested(1, {"seed": 2})]),
    ({"kind": "plan_wished", "plan": 1, "wish": {}}, [PlanRequested(1, {})]),
    ({"kind": "sprouting", "plan": 2, "picture": "a.jpg"}, [PlanPreview("a.jpg", 2)]),
    ({"kind": "growing", "picture": "a.jpg"}, [PlanPreview("a.jpg")]),
    ({"kind": "replanning", "share": 0.5, "left": 2.0}, [PlanningProgress(0.5, 2.0)]),
    ({"kind": "stroke", "done": 1, "of": 4, "left": 9.0}, [StrokePainted(1, 4), TimeLeft(9.0)]),
    ({"kind": "what nobody knows"}, []),
]  # fmt: skip


@pytest.mark.parametrize(("old", "means"), OLD)
def test_what_earlier_versions_wrote_means_the_same(old: dict[str, Any], means: list[Written]) -> None:
    assert events_of({"at": AT, **old}) == means


@given(st.sampled_from(sorted(KINDS)), st.dictionaries(st.sampled_from(["done", "plan", "what", "stroke"]), st.text()))
def test_what_lacks_something_is_refused_and_never_half_understood(kind: str, facts: dict[str, str]) -> None:
    try:
        found = events_of({"kind": kind, "at": AT, **facts})
    except ValueError:
        return
    assert [type(event) for event in found] == [KINDS[kind]]


def test_an_old_journal_tells_the_same_history_before_and_after_it_is_renewed() -> None:
    lines: list[dict[str, Any]] = [
        {**OLD[0][0], "format": "frida-painter journal", "version": 1},
        *({"kind": "ended", "stroke": stroke} for stroke in (1, 2, 3)),
        {"kind": "ended", "paint": 1, "cleaned": True},
        {"kind": "began", "what": ["stroke 4"], "stroke": 4, "plan": "f"},
        {"kind": "broken off", "reason": "The robot is gone."},
        {"kind": "resumed", "painted": 3, "in_doubt": 4, "decision": "skip", "by": "a", "process": 1, "program": "0"},
        {"kind": "ended", "stroke": 5, "left_out": True},
        {"kind": "protected", "region": "regions/1.png", "only": True},
        {"kind": "redirected", "goal": "changes/1"},
        {"kind": "ended", "stroke": 6},
        {"kind": "finished", "painted": 6},
    ]
    lines = [{"at": AT, **line} for line in lines]
    before, after = (History.of(each, Path()) for each in (lines, upgrade_journal(lines)))
    assert before == after
    assert (before.painted, before.given_up, before.dips, before.cleanings, before.runs) == (6, [4, 5], 1, 1, 2)
    assert (before.region, before.goal, before.finished) == (("regions/1.png", True), "changes/1", True)
    assert upgrade_journal(lines)[0]["version"] == 2
    assert not {line["kind"] for line in upgrade_journal(lines)} - set(KINDS)


@pytest.mark.parametrize("kind", get_args(Kind))
def test_every_command_has_a_meaning(kind: str) -> None:
    assert isinstance(command(kind, count=3, record=2), get_args(PaintingCommand))
    with pytest.raises(ConfigError, match="there are pause"):
        command(f"{kind}!")


def test_the_language_is_read_without_torch() -> None:
    code = "import frida_painter.session.events, frida_painter.web.commands, sys; sys.exit('torch' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
