"""Descriptions of sweeps, as a TOML file or from Python, and the runs that follow.

A grid makes a run of every combination of its values. A list makes the runs that it names. With both, every run of
the list is made with every combination. The settings are common to all runs.
"""

import hashlib
import json
import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from frida_painter import storage
from frida_painter.errors import ConfigError
from frida_painter.objectives.objective import Gives, goal_kinds
from frida_painter.provenance import identify_here
from frida_painter.runs.goal_item import GoalItem
from frida_painter.runs.shares import brush_file
from frida_painter.runs.spec import FILES, RunSpec

KINDS = ("plan", "painting", "evaluation")
PLAN = "plan"
"""Field of evaluations only: the file of the plan to paint."""
_MAX_BYTES = 2**22
_EXAMPLE = 'write lines such as kind = "plan", and under [grid] lines such as seed = [0, 1, 2]'
_SECONDS, _CORES, _MEMORY, _TRIES = 30 * 86400, 256, 2**20, 20  # upper limits
_ALLOWED = {
    "version": "1",
    "title": "text of at most 80 characters",
    "kind": f"one of {', '.join(KINDS)}",
    "settings": "a section of fields, [settings]",
    "grid": "a section of fields with lists of values, [grid]",
    "runs": "a list of sections, [[runs]]",
    "time_limit": f"a number of seconds above 0, at most {_SECONDS}",
    "threads": f"a whole number of cores from 1 to {_CORES}",
    "memory": f"a whole number of MB from 100 to {_MEMORY}",
    "tries": f"a whole number from 1 to {_TRIES}",
}

Fields = Mapping[str, Any]
"""Fields of a run: those of RunSpec, `plan`, and the name of any kind of goal with one thing to paint."""


class SweepSpec(BaseModel):
    """Description of a sweep. `of` and `from_toml` raise ConfigError, which names all faults at once.

    kind: work of every run: "plan" for a bare canvas; "painting" in the virtual studio; "evaluation", which paints
        an existing plan without replanning
    settings: fields that all runs share
    grid: fields, each with a list of values
    runs: fields of single runs
    time_limit: seconds after which a try is given up
    threads, memory: cores and MB of a run
    tries: greatest number of tries of a run
    """

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)

    version: Literal[1] = 1
    title: str = Field("", max_length=80)
    kind: Literal["plan", "painting", "evaluation"] = "plan"
    settings: dict[str, Any] = {}
    grid: dict[str, list[Any]] = {}
    runs: list[dict[str, Any]] = [{}]
    time_limit: float = Field(3600.0, gt=0, le=_SECONDS, allow_inf_nan=False)
    threads: int = Field(1, ge=1, le=_CORES)
    memory: int = Field(1000, ge=100, le=_MEMORY)
    tries: int = Field(3, ge=1, le=_TRIES)

    @classmethod
    def of(cls, **values: Any) -> Self:
        """Returns a checked description. Raises ConfigError."""
        try:
            made = cls(**values)
        except ValidationError as error:
            raise ConfigError(f"The sweep cannot be read: {'; '.join(map(_sentence, error.errors()))}.") from error
        made._require_known_fields()
        return made

    @classmethod
    def from_toml(cls, path: Path) -> Self:
        """Returns a description from a TOML file; its paths are relative to that file. Raises ConfigError."""
        values = storage.read_toml(path, "a sweep (TOML)", _MAX_BYTES, _EXAMPLE)
        made = cls.of_files(values, path.absolute().parent)
        return made if made.title else made.model_copy(update={"title": path.stem.replace("_", " ").replace("-", " ")})

    @classmethod
    def of_files(cls, values: dict[str, Any], base: Path) -> Self:
        """Returns a checked description whose paths are relative to the folder `base`. Raises ConfigError."""
        values = dict(values)
        for name in ("settings", "grid"):
            if isinstance(values.get(name), dict):
                values[name] = {field: _resolve_paths(field, value, base) for field, value in values[name].items()}
        if isinstance(values.get("runs"), list):
            values["runs"] = [
                {field: _resolve_paths(field, value, base) for field, value in run.items()}
                if isinstance(run, dict)
                else run
                for run in values["runs"]
            ]
        return cls.of(**values)

    @property
    def count(self) -> int:
        """Number of runs, of which some may be equal."""
        return len(self.runs) * math.prod(len(values) for values in self.grid.values())

    @property
    def axes(self) -> tuple[str, ...]:
        """Fields in which runs differ, in order."""
        return tuple(dict.fromkeys((*self.grid, *(name for run in self.runs for name in run))))

    def fields(self) -> Iterator[tuple[Fields, Fields]]:
        """Yields for every run the fields in which runs differ, and all of its fields."""
        for run in self.runs:
            for values in product(*self.grid.values()):
                differing = {**dict(zip(self.grid, values, strict=True)), **run}
                yield differing, {**self.settings, **differing}

    def _require_known_fields(self) -> None:
        """Raises ConfigError for unknown fields, for a field without values, and for a sweep without runs."""
        known = {*RunSpec.model_fields, "brush", *goal_kinds().by_name, *([PLAN] if self.kind == "evaluation" else [])}
        faults = [
            f"{name[:40]!r} is not a field of a run; there are {', '.join(sorted(known - {'version'}))}"
            for name in sorted({*self.settings, *self.axes} - known)
        ]
        faults += [f"{name} has no values; give at least one" for name, values in self.grid.items() if not values]
        faults += [
            f"{name} stands in the grid and in [[runs]]; give it in one of them"
            for name in self.grid
            if any(name in run for run in self.runs)
        ]
        if not self.runs:
            faults.append("there are no runs; leave out the empty list, or give at least one run in it")
        if faults:
            raise ConfigError(f"The sweep cannot be read: {'; '.join(faults)}.")


def run_spec(fields: Fields) -> RunSpec:
    """Returns the run with these fields; fields named after a goal kind are added to its goal. Raises ConfigError."""
    kinds = goal_kinds().by_name
    for part in ("goal", "initial"):
        given = fields.get(part, [])
        if not isinstance(given, list | tuple) or any(isinstance(one, str | int | float) for one in given):
            raise ConfigError(
                f'{part} was given {str(given)[:40]!r}; it is a list of tables, as [{{ image = "a.jpg" }}].'
            )
    goal = [*fields.get("goal", []), *({name: fields[name]} for name in kinds if name in fields)]
    rest = {name: value for name, value in fields.items() if name not in kinds and name not in ("goal", PLAN)}
    return RunSpec.of(**rest, goal=goal)


def _resolve_paths(field: str, value: Any, base: Path) -> Any:
    """Returns a field with its paths relative to the sweep's folder; "*" in a picture's name stands for many files."""
    known = goal_kinds().by_name
    is_path = field in (*FILES, PLAN) or (field in known and known[field].gives is Gives.PICTURE)
    if isinstance(value, list) and field in ("goal", "initial"):
        return [_resolve_paths(field, one, base) for one in value]
    if isinstance(value, dict):
        return {name: _resolve_paths(name, one, base) for name, one in value.items()}
    if isinstance(value, list) and is_path:
        return [path for one in value for path in _each(one, base)]
    if is_path or (field in ("brush", "brushes") and isinstance(value, str) and Path(value).suffix):
        return str(base / value) if isinstance(value, str) and value else value
    return value


def _each(value: Any, base: Path) -> list[Any]:
    """Returns the files of a pattern, sorted; other values as one. Raises ConfigError if no file matches."""
    if not isinstance(value, str):
        return [value]
    if "*" not in value:
        return [str(base / value)]
    path = Path(value)
    found = sorted(str(one) for one in (base / path.parent).glob(path.name))
    if not found:
        raise ConfigError(
            f"No file is called {value[:80]} (in {storage.abridge(base)}); the sweep has nothing to paint."
        )
    return found


def _sentence(fault: Any) -> str:
    """Returns one of pydantic's faults in plain words."""
    entry, *within = map(str, fault["loc"])
    name = ".".join((entry, *within))[:60]
    if fault["type"] == "extra_forbidden":
        return f"{name[:40]!r} is unknown; there are {', '.join(SweepSpec.model_fields)}"
    given = repr(fault["input"])
    allowed = "a list of values, such as [1, 2]" if within and entry == "grid" else _ALLOWED[entry]
    return f"{name} was given {given if len(given) <= 40 else f'{given[:37]}...'}; it is {allowed}"


# One run of a sweep as a plain value, small enough to be sent anywhere, with a key that identifies it.

_KEY = 20  # hexadecimal digits: any two of a billion runs have the same key with a probability of about 10^-6

Value = str | int | float | bool | None
ContentHash = Callable[[Path], str]
"""Returns the hash of the content of a file or a folder."""


@dataclass(frozen=True)
class SweepRun:
    """Run of a sweep.

    key: hash of everything that determines the result, including file contents, versions, plug-ins and code
    kind: of work
    labels: the fields in which runs differ, as plain values for tables
    settings: fields of its RunSpec
    plan: file of the plan that an evaluation paints
    program: versions of this program, its libraries and plug-ins, and hashes of their code
    cost: relative duration
    """

    key: str
    kind: str
    labels: Mapping[str, Value]
    settings: Mapping[str, Any]
    plan: str | None = None
    program: str = ""
    cost: float = 1.0

    @classmethod
    def of(
        cls, kind: str, differing: Fields, fields: Fields, hash_of: ContentHash, program: str | None = None
    ) -> "SweepRun":
        """Returns the run with these fields. Raises ConfigError for invalid fields, and the errors of `hash_of`.

        program: what does the run, as `provenance.identify` tells it. None: what is here
        """
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
        program = identify_here() if program is None else program
        chosen = spec.record()
        goal = {part: [_identity(item, hash_of) for item in getattr(spec, part)] for part in ("goal", "initial")}
        files = {name: hash_of(Path(chosen[name])) for name in FILES if chosen[name] is not None}
        files |= {brush: hash_of(path) for brush in spec.brush_names if (path := brush_file(brush)) is not None}
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
        """Returns a spec as plain values from which RunSpec makes the same spec."""
        chosen = spec.record()
        settings = {name: chosen[name] for name in sorted(spec.model_fields_set) if name in chosen}
        return settings | {part: [item.model_dump() for item in getattr(spec, part)] for part in ("goal", "initial")}

    @property
    def spec(self) -> RunSpec:
        """RunSpec of the run."""
        return RunSpec.of(**self.settings)

    @property
    def pictures(self) -> tuple[str, ...]:
        """Files of its goal's pictures."""
        kinds = goal_kinds()
        return tuple(
            item["value"]
            for part in ("goal", "initial")
            for item in self.settings[part]
            if GoalItem(**item).path is not None and item["kind"] in kinds.by_name
        )

    def with_pictures(self, copies: Mapping[str, str]) -> "SweepRun":
        """Returns the run with copies of its pictures, which are given by path."""
        settings = dict(self.settings)
        for part in ("goal", "initial"):
            settings[part] = [{**item, "value": copies.get(item["value"], item["value"])} for item in settings[part]]
        return SweepRun(**{**self.__dict__, "settings": settings})


def label(value: Any) -> Value:
    """Returns a field's value for tables: the name of a file without its folder, the content of a goal."""
    if isinstance(value, list):
        return " + ".join(str(label(one)) for one in value)
    if isinstance(value, dict):
        return ", ".join(f"{name} {label(one)}" for name, one in value.items() if name != "weight" or one != 1)
    if isinstance(value, str) and "/" in value and Path(value).suffix:
        return Path(value).name
    return value if isinstance(value, str | int | float | bool) or value is None else str(value)


def _identity(item: GoalItem, hash_of: ContentHash) -> list[Value]:
    """Returns a goal as its kind, its content (words, or the hash of a file) and its weight."""
    return [item.kind, item.value if item.path is None else hash_of(item.path), item.weight]


def _cost(spec: RunSpec, kind: str) -> float:
    """Returns the relative duration of a run: planning grows with strokes and effort, painting with strokes."""
    replans = 0.15 * spec.replans if kind == "painting" else 0.0
    planning = (1 + replans) * (60 + spec.strokes) * spec.effort * (spec.render_height / 256) ** 1.3
    painting = 0.4 * spec.strokes + 10
    return {"plan": planning, "painting": planning + painting, "evaluation": painting}[kind] + 4
