"""The one language of events: everything written is read again."""

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from frida_painter.session.events import (
    KINDS,
    Dipped,
    Failed,
    Finished,
    Looked,
    MotionBegan,
    PaintingBegun,
    Paused,
    PlanRequested,
    SessionResumed,
    StrokeLeftOut,
    StrokePainted,
    Written,
    events_of,
    record,
    time_of,
)
from frida_painter.session.journal import History
from frida_painter.session.person_events import GoalChanged, RegionProtected

AT = "2026-01-02T03:04:05.678+00:00"
VALUES: dict[str, Any] = {
    "int": 3, "float": 0.25, "str": "words", "bool": True, "int | None": 3, "str | None": "a.jpg",
    "dict[str, Any]": {"a": [1]}, "dict[str, str]": {"a": "b"}, "dict[str, float]": {"a": 0.5},
    "tuple[float, ...]": (0.5,), "list[int]": [0, 2], "list[str]": ["canvas"],
    "list[dict[str, Any]]": [{"hex": "#000"}], "list[dict[str, str]]": [{"name": "grbl"}],
    "list[list[float]] | None": [[0.5]], "tuple[str, ...]": ("home",),
    "PauseCause": "turn", "tuple[float, float, float]": (0.1, 0.2, 0.3), "tuple[tuple[float, ...], ...]": ((1.0, 0.0),),
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


def test_an_unknown_kind_says_nothing_and_a_former_name_says_the_same() -> None:
    assert events_of({"at": AT, "kind": "what nobody knows"}) == events_of({"at": AT}) == []
    assert events_of({"at": AT, "kind": "plan_wished", "plan": 1, "wish": {}}) == [PlanRequested(1, {})]


@pytest.mark.parametrize(
    ("fields", "cause"),
    [
        ({}, "trouble"),
        ({"turn": True}, "turn"),
        ({"turn": False, "asked": True}, "person"),
        ({"asked": False}, "trouble"),
    ],
)
def test_a_pause_of_an_earlier_version_has_its_cause(fields: dict[str, bool], cause: str) -> None:
    written = {"at": AT, "kind": "paused", "reason": "Why.", "done": 2, **fields}
    assert events_of(written) == [Paused("Why.", 2, cause)]  # type: ignore[arg-type]


@given(st.sampled_from(sorted(KINDS)), st.dictionaries(st.sampled_from(["done", "plan", "what", "stroke"]), st.text()))
def test_what_lacks_something_is_refused_and_never_half_understood(kind: str, facts: dict[str, str]) -> None:
    try:
        found = events_of({"kind": kind, "at": AT, **facts})
    except ValueError:
        return
    assert [type(event) for event in found] == [KINDS[kind]]


def test_a_journal_tells_the_history_of_its_painting() -> None:
    begun = PaintingBegun({"strokes": 6}, {}, "a", 1, "0")
    events: list[Written] = [
        *(StrokePainted(stroke) for stroke in (1, 2, 3)),
        Dipped(1, cleaned=True),
        MotionBegan(("stroke 4",), 4, "f"),
        Failed("The robot is gone."),
        SessionResumed(3, 4, "skip", "a", 1, "0"),
        StrokeLeftOut(5),
        RegionProtected("regions/1.png", only=True),
        GoalChanged("changes/1", {}),
        StrokePainted(6),
        Finished(6, 4.5),
    ]
    first = {"format": "frida-painter journal", "version": 2, **record(begun)}
    told = History.of([first, *map(record, events)], Path())
    assert (told.painted, told.given_up, told.dips, told.cleanings, told.runs) == (6, [4, 5], 1, 1, 2)
    assert (told.region, told.goal) == (("regions/1.png", True), "changes/1")
    assert (told.finished, told.robot_seconds) == (True, 4.5)


def test_the_language_is_read_without_torch() -> None:
    code = "import frida_painter.session.events, frida_painter_studio.commands, sys; sys.exit('torch' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
