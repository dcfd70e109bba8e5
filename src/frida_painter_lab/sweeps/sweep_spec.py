"""Descriptions of sweeps, as a TOML file or from Python, the runs that follow, and their folder.

A grid makes a run of every combination of its values. A list makes the runs that it names. With both, every run of
the list is made with every combination. The settings are common to all runs.

| file in the folder | content |
|---|---|
| sweep.json | the latest request of the sweep, with the hashes of its files |
| runs/KEY/ | one run: result.json if it is done, failure.json if its last try failed, plan and pictures |
| table.parquet | all results; it can be made again from the runs |
| index.html | the page of `sweep report` |
"""

import contextlib
import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import product
from pathlib import Path
from typing import Any, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from frida_painter.errors import ConfigError, FridaError, StorageError, SweepBusy
from frida_painter.objectives.objective import Gives, goal_kinds
from frida_painter.planning.fields import brush_file
from frida_painter.runs.painting_folder import content_hash
from frida_painter.runs.spec import FILES, RunSpec
from frida_painter.system import locks, storage
from frida_painter.system.provenance import identify_here
from frida_painter_lab.runs import LOCK, Run, Value, content_key, goal_facts, hold_lock

PLAN = "plan"
"""Field of evaluations only: the file of the plan to paint."""
_MAX_BYTES = 2**22
_MAX_FAULTS = 5
_EXAMPLE = 'write lines such as kind = "plan", and under [grid] lines such as seed = [0, 1, 2]'

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
    time_limit: float = Field(3600.0, gt=0, le=30 * 86400, allow_inf_nan=False)
    threads: int = Field(1, ge=1, le=256)
    memory: int = Field(1000, ge=100, le=2**20)
    tries: int = Field(3, ge=1, le=20)

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

        def resolve(fields: Any) -> Any:
            if not isinstance(fields, dict):
                return fields
            return {name: _resolve_paths(name, value, base) for name, value in fields.items()}

        values = {**values, **{name: resolve(values[name]) for name in ("settings", "grid") if name in values}}
        if isinstance(values.get("runs"), list):
            values["runs"] = [resolve(run) for run in values["runs"]]
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
        for name, values in self.grid.items():
            if not values:
                faults.append(f"{name} has no values; give at least one")
            if any(name in run for run in self.runs):
                faults.append(f"{name} stands in the grid and in [[runs]]; give it in one of them")
        if not self.runs:
            faults.append("there are no runs; leave out the empty list, or give at least one run in it")
        if faults:
            raise ConfigError(f"The sweep cannot be read: {'; '.join(faults)}.")


def _sentence(fault: Any) -> str:
    """Returns one of pydantic's faults in plain words."""
    name = ".".join(map(str, fault["loc"]))[:60]
    if fault["type"] == "extra_forbidden":
        return f"{name[:40]!r} is unknown; there are {', '.join(SweepSpec.model_fields)}"
    return f"{name} was given {repr(fault['input'])[:40]}; it {fault['msg'].removeprefix('Input ')}"


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
    if not isinstance(value, str) or "*" not in value:
        return [str(base / value) if isinstance(value, str) else value]
    path = Path(value)
    found = sorted(str(one) for one in (base / path.parent).glob(path.name))
    if not found:
        raise ConfigError(
            f"No file is called {value[:80]} (in {storage.abridge(base)}); the sweep has nothing to paint."
        )
    return found


class FileHashes:
    """Hashes of files by path, each computed once.

    known: hashes from the start of the sweep
    """

    def __init__(self, known: Mapping[str, str] | None = None) -> None:
        self.by_path = dict(known or {})

    def of(self, path: Path) -> str:
        """Returns the hash of a file, or of all files in a folder. Raises ConfigError if it is missing and unknown."""
        name = str(path.absolute())
        if name not in self.by_path:
            if not storage.exists(path):
                raise ConfigError(f"{storage.abridge(path)} does not exist; a run of the sweep needs it.")
            self.by_path[name] = content_hash(path)
        return self.by_path[name]


@dataclass(frozen=True, kw_only=True)
class SweepRun(Run):
    """Run of a sweep: a RunSpec and what is done with it.

    kind: of work
    spec: of the painting
    plan: file of the plan that an evaluation paints
    program: versions of this program, its libraries and plug-ins, and hashes of their code
    files: hashes of the files that decide the result, by path
    """

    kind: str
    spec: RunSpec
    plan: str | None = None
    program: str = ""
    files: Mapping[str, str] = field(default_factory=dict)

    @cached_property
    def key(self) -> str:
        """Hash of everything that determines the result. Labels do not count: other sweeps have other ones."""
        return content_key(self.program, self.kind, self.depends_on)

    @classmethod
    def of(
        cls, kind: str, differing: Fields, fields: Fields, hash_of: Callable[[Path], str], program: str | None = None
    ) -> Self:
        """Returns the run with these fields. Raises ConfigError for invalid fields, and the errors of `hash_of`.

        hash_of: hash of the content of a file or a folder
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
        chosen = spec.record()
        files = {name: Path(chosen[name]) for name in FILES if chosen[name] is not None}
        files |= {brush: path for brush in spec.brush_names if (path := brush_file(brush)) is not None}
        files |= {} if plan is None else {PLAN: Path(plan)}
        pictures = [item.path for item in (*spec.goal, *spec.initial) if item.path is not None]
        return cls(
            labels={name: label(value) for name, value in differing.items()},
            depends_on={**chosen, **goal_facts(spec, hash_of), **{name: hash_of(path) for name, path in files.items()}},
            kind=kind,
            spec=spec,
            plan=plan,
            program=identify_here() if program is None else program,
            files={str(path): hash_of(path) for path in (*pictures, *files.values())},
        )


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


def expand_runs(spec: SweepSpec, hashes: FileHashes, program: str | None = None) -> tuple[SweepRun, ...]:
    """Returns the runs in order, each once. Raises ConfigError, which names the first few faults.

    program: what did the runs of an existing sweep. None: what is here
    """
    program = identify_here() if program is None else program
    told = {}
    for name in spec.axes:  # values with the same label, such as files of one name in two folders, are told in full
        values = [*spec.grid.get(name, []), *(run[name] for run in spec.runs if name in run)]
        labels = {repr(value): label(value) for value in values}
        told[name] = labels if len(set(labels.values())) == len(labels) else {repr(one): str(one) for one in values}
    runs, faults = dict[str, SweepRun](), dict[str, None]()
    for differing, fields in spec.fields():
        try:
            run = SweepRun.of(spec.kind, differing, fields, hashes.of, program)
        except FridaError as error:
            faults[str(error)] = None
            if len(faults) == _MAX_FAULTS:
                break
            continue
        named = {name: told[name][repr(value)] for name, value in differing.items()}
        runs.setdefault(run.key, replace(run, labels=named))
    if faults:
        raise ConfigError(" ".join(faults))
    return tuple(runs.values())


def label(value: Any) -> Value:
    """Returns a field's value for tables: the name of a file without its folder, the content of a goal."""
    if isinstance(value, list):
        return " + ".join(str(label(one)) for one in value)
    if isinstance(value, dict):
        return ", ".join(f"{name} {label(one)}" for name, one in value.items() if name != "weight" or one != 1)
    if isinstance(value, str) and "/" in value and Path(value).suffix:
        return Path(value).name
    return value if isinstance(value, str | int | float | bool) or value is None else str(value)


SWEEP = "sweep.json"
TABLE = "table.parquet"
_FORMAT = "frida-painter sweep"
_ROOM = 100 * 2**20  # bytes


class SweepFolder:
    """Folder of a sweep."""

    def __init__(self, path: Path) -> None:
        self.path = path.absolute()

    @contextlib.contextmanager
    def lock(self) -> Iterator[None]:
        """Locks the folder for one driver.

        Raises SweepBusy if another process has it, StorageError if it cannot be used.
        """
        place = storage.abridge(self.path)
        storage.require_space(self.path, _ROOM, "this sweep")
        if not self.is_begun and self._holds_something_else():
            raise StorageError(f"{place} holds something that is no sweep; choose a new folder with --out.")
        busy = SweepBusy(
            f"Another process works on {place}; wait until it is done, or look how far it is: frida-painter sweep "
            f"status {place}"
        )
        with hold_lock(self.path, 0.0, busy):
            yield

    def _holds_something_else(self) -> bool:
        """Returns True if the folder holds more than the lock and what a killed process left. Raises StorageError."""
        try:
            there = {one.name for one in self.path.iterdir()} if self.path.exists() else set()
            return bool(there - {LOCK, *(one.name for one in self.path.glob(f"{storage.PART}*"))})
        except OSError as error:
            raise storage.cannot_write(self.path, error) from error

    @property
    def is_begun(self) -> bool:
        """True if the folder contains a sweep."""
        return (self.path / SWEEP).exists()

    @property
    def is_held(self) -> bool:
        """True if a driver works on it now."""
        try:
            return locks.is_held(self.path / LOCK)
        except OSError:  # another person's
            return True

    def keep(self, spec: SweepSpec, hashes: Mapping[str, str], slots: int) -> None:
        """Writes the request, with the program that does the runs.

        hashes: of files by their paths
        slots: number of runs at the same time
        """
        request = {"sweep": spec.model_dump(mode="json"), "files": dict(hashes), "slots": slots}
        storage.write_json(self.path / SWEEP, {"format": _FORMAT, **request, "program": identify_here()})

    def read_request(self) -> tuple[SweepSpec, dict[str, str], int, str]:
        """Returns the latest request: the sweep, hashes of files by path, slots, and what did the runs.

        Raises ConfigError.
        """
        path = self.path / SWEEP
        if not self.is_begun:
            raise ConfigError(
                f"{storage.abridge(self.path)} holds no sweep; give the folder of one, such as sweeps/NAME."
            )
        kept = storage.read_json(path, "a sweep", ConfigError)
        if kept.get("format") != _FORMAT:
            raise ConfigError(f"{storage.abridge(path)} is no sweep of this program; give the folder of one.")
        with storage.understanding(path, "a sweep", ConfigError):
            return SweepSpec.of(**kept["sweep"]), dict(kept["files"]), int(kept["slots"]), str(kept["program"])
