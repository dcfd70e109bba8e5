"""The runs that a sweep makes, each once, by the content of the files that they are of."""

import os
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

from frida_painter import storage
from frida_painter.errors import ConfigError, FridaError
from frida_painter.runs.folder import content_hash
from frida_painter.sweeps.run import SweepRun, Value, label
from frida_painter.sweeps.spec import Fields, SweepSpec

_MOST_FAULTS = 5


class FileHashes:
    """The hashes of files by their paths, each read once; of one that has vanished, the one that is known.

    known: those of the day on which the sweep was begun; reread: whether files that are there are read again.
    """

    def __init__(self, known: Mapping[str, str] | None = None, *, reread: bool = True) -> None:
        self._known = known or {}
        self.by_path = {} if reread else dict(self._known)
        self.vanished: list[str] = []

    def of(self, path: Path) -> str:
        """The hash of a file, or of all in a folder. Raises ConfigError where it is not there and never was."""
        name = str(path.absolute())
        if name not in self.by_path:
            if storage.exists(path):
                self.by_path[name] = content_hash(path)
            elif name in self._known:
                self.vanished.append(path.name)
                self.by_path[name] = self._known[name]
            else:
                raise ConfigError(f"{storage.shown(path)} does not exist; a run of the sweep needs it.")
        return self.by_path[name]


def expanded(spec: SweepSpec, hashes: FileHashes) -> tuple[SweepRun, ...]:
    """The runs in their order, each once. Raises ConfigError, naming the first few faults."""
    runs, faults = dict[str, SweepRun](), list[str]()
    told = _Labels(spec)
    for differing, fields in spec.fields():
        try:
            run = SweepRun.of(spec.kind, differing, fields, hashes.of)
        except FridaError as error:
            if str(error) not in faults:
                faults.append(str(error))
            if len(faults) == _MOST_FAULTS:
                break
            continue
        runs.setdefault(run.key, replace(run, labels=told.of(differing)))
    if faults:
        raise ConfigError(" ".join(faults))
    return tuple(runs.values())


class _Labels:
    """What the values of the fields in which runs differ are called, so that no two are called the same."""

    def __init__(self, spec: SweepSpec) -> None:
        self._named: dict[str, dict[str, Value]] = {name: {} for name in spec.axes}
        values = [(name, value) for name, several in spec.grid.items() for value in several]
        values += [(name, value) for run in spec.runs for name, value in run.items()]
        for name, value in values:
            self._named[name][repr(value)] = label(value)
        for name, known in self._named.items():
            if len(set(known.values())) < len(known):  # the same file name in several folders, for one
                files = [value for field, value in values if field == name and isinstance(value, str)]
                if len(set(files)) == len(known) and all("/" in file for file in files):
                    above = os.path.commonpath([str(Path(file).parent) for file in files])
                    known |= {repr(file): str(Path(file).relative_to(above)) for file in files}
                else:
                    known |= {value: value for value in known}

    def of(self, differing: Fields) -> dict[str, Value]:
        """The labels of a run by these fields."""
        return {name: self._named[name][repr(value)] for name, value in differing.items()}
