"""Translation of records from earlier versions of journals and feeds into the current form.

Earlier versions used two languages, and one word could mean two things. For example, "planned" was an adopted plan
in a journal but a ready plan in a feed. The other fields of a record tell which one it is.
"""

from collections.abc import Callable, Mapping
from typing import Any

_Record = Mapping[str, Any]


def upgrade_event(record: _Record) -> list[dict[str, Any]]:
    """Returns the current records that say the same as this one; a current record stays as it is."""
    change = _CHANGES.get(str(record.get("kind")))
    return [dict(record)] if change is None else change(record)


def _rename_fields(kind: str, **names: str) -> Callable[[_Record], list[dict[str, Any]]]:
    """Returns a change that gives a record a new kind and new field names: new="old"."""

    def change(record: _Record) -> list[dict[str, Any]]:
        moved = {new: record[old] for new, old in names.items() if old in record}
        return [{**record, **moved, "kind": kind}]

    return change


def _either(key: str, there: str, otherwise: str) -> Callable[[_Record], list[dict[str, Any]]]:
    """Returns a change that gives a record one of two kinds: `there` if it has the field, else `otherwise`."""
    return lambda record: [{**record, "kind": there if key in record else otherwise}]


def _upgrade_begun(record: _Record) -> list[dict[str, Any]]:
    if "settings" in record:
        return [{**record, "kind": "painting_begun"}]
    return [{**record, "kind": "calibration_started" if "what" in record else "painting_started"}]


def _upgrade_resumed(record: _Record) -> list[dict[str, Any]]:
    if "painted" not in record:
        return [{**record, "kind": "went_on"}]
    return [{**record, "kind": "session_resumed", "done": record["painted"]}]


def _upgrade_planned(record: _Record) -> list[dict[str, Any]]:
    if "placement" not in record:
        return [{**record, "kind": "plan_made"}]
    return [{**record, "kind": "plan_adopted", **record["placement"]}]


def _upgrade_ended(record: _Record) -> list[dict[str, Any]]:
    if "stroke" not in record:
        return [{**record, "kind": "dipped"}]
    kind = "stroke_left_out" if record.get("left_out", False) else "stroke_painted"
    return [{**record, "kind": kind, "done": record["stroke"]}]


def _stroke(record: _Record) -> list[dict[str, Any]]:
    left = [{"kind": "time_left", "seconds": record["left"]}] if "left" in record else []
    return [{**record, "kind": "stroke_painted"}, *left]


def _upgrade_finished(record: _Record) -> list[dict[str, Any]]:
    if "film" in record:
        return [{**record, "kind": "painting_kept"}]
    return [{**record, "done": record.get("painted", record.get("done"))}]


_CHANGES: Mapping[str, Callable[[_Record], list[dict[str, Any]]]] = {
    "begun": _upgrade_begun,
    "resumed": _upgrade_resumed,
    "planned": _upgrade_planned,
    "looked": _either("seen", "look_shown", "photographed"),
    "began": _rename_fields("motion_began"),
    "ended": _upgrade_ended,
    "paused": _rename_fields("paused", done="painted"),
    "stopped": _rename_fields("stopped", done="painted"),
    "finished": _upgrade_finished,
    "broken off": _rename_fields("failed"),
    "failed": _rename_fields("failed", reason="sentence"),
    "protected": _rename_fields("region_protected"),
    "region": lambda record: [{**record, "kind": "region_protected", "region": record["picture"]}],
    "redirected": lambda record: [{"wish": {}, **record, "kind": "goal_changed"}],
    "changed": lambda record: [{"goal": "", **record, "kind": "goal_changed"}],
    "wished": _rename_fields("plan_requested"),
    "plan_wished": _rename_fields("plan_requested"),
    "planning": _rename_fields("planning_progress"),
    "replanning": _rename_fields("planning_progress"),
    "sprouting": _rename_fields("plan_preview"),
    "growing": _rename_fields("plan_preview"),
    "replanned": _rename_fields("rest_replanned"),
    "taken up": _rename_fields("taken_up"),
    "stroke": _stroke,
    "photograph": _rename_fields("photograph_shown"),
    "standing": _rename_fields("calibration_status"),
    "procedure": _rename_fields("procedure_began"),
    "progress": _rename_fields("procedure_progress"),
    "found": _rename_fields("procedure_found"),
}
