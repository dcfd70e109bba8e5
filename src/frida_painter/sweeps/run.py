"""One run of a sweep as a plain value, small enough to be sent anywhere, and what tells it from every other run."""

import hashlib
import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

from frida_painter.errors import ConfigError
from frida_painter.objectives.kind import goal_kinds
from frida_painter.runs.goal_item import GoalItem
from frida_painter.runs.spec import FILES, RunSpec
from frida_painter.sweeps.spec import PLAN, Fields, run_spec

_KEY = 20  # hexadecimal digits: two of a billion runs have one key with a chance of 1 in 10^6

Value = str | int | float | bool | None
ContentHash = Callable[[Path], str]
"""The hash of what a file, or a folder, holds."""


@dataclass(frozen=True)
class SweepRun:
    """A run: its key, what is done, its settings as RunSpec takes them, and the plan that an evaluation paints.

    labels: the fields by which it differs from the others, as plain values for tables; key: of the content of
    everything that decides what comes out, the version of this program included; cost: how long it takes, in a unit of
    its own.
    """

    key: str
    kind: str
    labels: Mapping[str, Value]
    settings: Mapping[str, Any]
    plan: str | None = None
    program: str = ""
    cost: float = 1.0

    @classmethod
    def of(cls, kind: str, differing: Fields, fields: Fields, hash_of: ContentHash) -> "SweepRun":
        """The run of these fields. Raises ConfigError for fields that make none, and what `hash_of` raises."""
        spec = run_spec(fields)
        if kind != "plan" and not spec.simulated:
            raise ConfigError(
                f"A sweep paints in the virtual studio, and --robot {spec.robot[:60]} is a real one; leave it out."
            )
        plan = fields.get(PLAN)
        if kind == "evaluation" and not (isinstance(plan, str) and plan):
            raise ConfigError("An evaluation paints a plan that was made before; name its file: plan = FILE.")
        if not spec.goal:
            raise ConfigError('A run has nothing to paint; name a picture or words, such as image = "photo.jpg".')
        program = version("frida-painter")
        chosen = spec.record()
        goal = {part: [_identity(item, hash_of) for item in getattr(spec, part)] for part in ("goal", "initial")}
        files = {name: hash_of(Path(chosen[name])) for name in FILES if chosen[name] is not None}
        files |= {brush: hash_of(Path(brush)) for brush in spec.brush_names if Path(brush).suffix}
        if plan is not None:
            files[PLAN] = hash_of(Path(plan))
        everything = json.dumps([program, kind, {**chosen, **goal, **files}], sort_keys=True)
        return cls(
            key=hashlib.sha256(everything.encode()).hexdigest()[:_KEY],
            kind=kind,
            labels={name: label(value) for name, value in differing.items()},
            settings=cls.settings_of(spec),
            plan=plan,
            program=program,
            cost=_cost(spec, kind),
        )

    @staticmethod
    def settings_of(spec: RunSpec) -> dict[str, Any]:
        """A description as plain values of which RunSpec makes the same again."""
        chosen = spec.record()
        settings = {name: chosen[name] for name in sorted(spec.model_fields_set) if name in chosen}
        return settings | {part: [item.model_dump() for item in getattr(spec, part)] for part in ("goal", "initial")}

    @property
    def spec(self) -> RunSpec:
        """Its description."""
        return RunSpec.of(**self.settings)

    @property
    def pictures(self) -> tuple[str, ...]:
        """The files of the pictures of its goal."""
        kinds = goal_kinds()
        return tuple(
            item["value"]
            for part in ("goal", "initial")
            for item in self.settings[part]
            if GoalItem(**item).path is not None and item["kind"] in kinds.by_name
        )

    def with_pictures(self, copies: Mapping[str, str]) -> "SweepRun":
        """The same with copies of its pictures, by their paths."""
        settings = dict(self.settings)
        for part in ("goal", "initial"):
            settings[part] = [{**item, "value": copies.get(item["value"], item["value"])} for item in settings[part]]
        return SweepRun(**{**self.__dict__, "settings": settings})


def label(value: Any) -> Value:
    """A field's value as tables show it: of a file its name without the folder, of a goal what is painted."""
    if isinstance(value, list):
        return " + ".join(str(label(one)) for one in value)
    if isinstance(value, dict):
        return ", ".join(f"{name} {label(one)}" for name, one in value.items() if name != "weight" or one != 1)
    if isinstance(value, str) and "/" in value and Path(value).suffix:
        return Path(value).name
    return value if isinstance(value, str | int | float | bool) or value is None else str(value)


def _identity(item: GoalItem, hash_of: ContentHash) -> list[Value]:
    """A thing to paint as what it really is: words, or the content of a file."""
    return [item.kind, item.value if item.path is None else hash_of(item.path), item.weight]


def _cost(spec: RunSpec, kind: str) -> float:
    """How long a run takes beside others: planning grows with strokes and effort, painting with strokes."""
    replans = 0.15 * spec.replans if kind == "painting" else 0.0
    planning = (1 + replans) * (60 + spec.strokes) * spec.effort * (spec.render_height / 256) ** 1.3
    painting = 0.4 * spec.strokes + 10
    return {"plan": planning, "painting": planning + painting, "evaluation": painting}[kind] + 4
