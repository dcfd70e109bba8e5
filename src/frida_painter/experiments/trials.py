"""An experiment: a list of trials, what is measured of each, and a report of what all of them show.

A trial stands alone. Everything that its measurement depends on is in it, so that trials can run in any order and in
any process. Finished ones are kept on the disk, and an experiment that was interrupted goes on from there.
"""

import hashlib
import json
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from importlib.metadata import version
from pathlib import Path
from typing import Generic, TypeVar

import numpy as np
from torch import Tensor

from frida_painter import images, storage
from frida_painter.errors import ImageError, StorageError
from frida_painter.experiments.outcome import Notify, Outcome, Row, each, silent

Labels = Mapping[str, str | int]
"""What tells a trial from the others: the first columns of its row in the table of results."""


@dataclass(frozen=True)
class ExperimentTrial:
    """One part of an experiment. depends_on: plain values, all that its measurement follows from beside its labels."""

    labels: Labels
    depends_on: Mapping[str, object] = field(default_factory=dict)

    def __getitem__(self, label: str) -> str:
        """A label as text."""
        return str(self.labels[label])

    @property
    def name(self) -> str:
        """The labels as the name of a file."""
        return re.sub(r"[^\w.]+", "-", "-".join(map(str, self.labels.values()))).strip("-.")

    @property
    def fingerprint(self) -> str:
        """sha256 of everything that the measurement follows from, the version of this program included."""
        everything = [version("frida-painter"), dict(self.labels), dict(self.depends_on)]
        return hashlib.sha256(json.dumps(everything, sort_keys=True).encode()).hexdigest()


AnyTrial = TypeVar("AnyTrial", bound=ExperimentTrial)


@dataclass(frozen=True)
class Measurement:
    """What was measured in a trial: numbers by name, and pictures [3, H, W] by name."""

    numbers: Mapping[str, float]
    pictures: Mapping[str, Tensor] = field(default_factory=dict)


@dataclass(frozen=True)
class Results:
    """The measurements of all trials, in their order."""

    found: tuple[tuple[Labels, Measurement], ...]

    def having(self, **labels: str | int) -> list[Measurement]:
        """Those of the trials with these labels."""
        return [found for its, found in self.found if all(its[name] == value for name, value in labels.items())]

    def one(self, **labels: str | int) -> Measurement:
        """That of the one trial with these labels."""
        (found,) = self.having(**labels)
        return found

    def values(self, number: str, **labels: str | int) -> list[float]:
        """One of the numbers of the trials with these labels."""
        return [found.numbers[number] for found in self.having(**labels)]

    def mean(self, number: str, **labels: str | int) -> float:
        """The mean of `values`."""
        return float(np.mean(self.values(number, **labels)))

    def rows(self) -> tuple[Row, ...]:
        """A table with a row for every trial: its labels and its numbers."""
        return tuple({**labels, **found.numbers} for labels, found in self.found)

    def means(self, label: str) -> tuple[Row, ...]:
        """A table with a row for every value of a label: the means of all numbers."""
        values = dict.fromkeys(its[label] for its, _ in self.found)
        names = list(self.found[0][1].numbers)
        return tuple({label: value, **{name: self.mean(name, **{label: value}) for name in names}} for value in values)


@dataclass(frozen=True)
class Experiment(Generic[AnyTrial]):
    """What an experiment does.

    measure: does one trial, and tells how far it is; report: makes tables, notes and pictures of all measurements;
    sharing: the label of trials that share work where only this label differs, and are measured by one process.
    """

    trials: Sequence[AnyTrial]
    measure: Callable[[AnyTrial, Notify], Measurement]
    report: Callable[[Results], Outcome]
    sharing: str = ""

    def run(self, keep: Path | None = None, notify: Notify = silent) -> Outcome:
        """Does every trial that is not in `keep`, a folder in which finished ones wait in case the rest is interrupted.

        Raises what `measure` raises, and StorageError.
        """
        found = []
        for trial, telling in each(self.trials, notify):
            found.append((trial.labels, self.measured(trial, keep, telling)))
        return self.report(Results(tuple(found)))

    def shares(self, keep: Path) -> list[tuple[int, ...]]:
        """The numbers of the trials that are not in `keep`: those that share work together, the others alone."""
        found: dict[str, list[int]] = {}
        for number, trial in enumerate(self.trials):
            if _read(keep, trial) is None:
                rest = {name: value for name, value in trial.labels.items() if name != self.sharing}
                found.setdefault(json.dumps(rest), []).append(number)
        return [tuple(numbers) for numbers in found.values()]

    def measured(self, trial: AnyTrial, keep: Path | None, notify: Notify) -> Measurement:
        """The measurement of a trial, from `keep` where it waits there. Raises what `measure` raises, StorageError."""
        if keep is None:
            return self.measure(trial, notify)
        measured = _read(keep, trial)
        if measured is None:
            measured = self.measure(trial, notify)
            _keep(keep, trial, measured)
        return measured


def _keep(folder: Path, trial: ExperimentTrial, measured: Measurement) -> None:
    for name, picture in measured.pictures.items():
        images.save(picture, folder / f"{trial.name}-{name}.png")
    record = {"of": trial.fingerprint, "numbers": dict(measured.numbers), "pictures": list(measured.pictures)}
    storage.write_json(folder / f"{trial.name}.json", record)


def _read(folder: Path, trial: ExperimentTrial) -> Measurement | None:
    """What was kept of a trial, with pictures in 8 bits; None where it depended on something else or is damaged."""
    try:
        record = storage.read_json(folder / f"{trial.name}.json", "a measurement of an experiment")
        if record["of"] != trial.fingerprint:
            return None
        pictures = {name: images.load(folder / f"{trial.name}-{name}.png") for name in record["pictures"]}
    except (StorageError, ImageError, KeyError):
        return None
    return Measurement(record["numbers"], pictures)
