"""How far a sweep is, read from its folder: while another process works on it, and after."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from frida_painter.session.forecast import duration
from frida_painter.sweeps.expansion import FileHashes, expanded
from frida_painter.sweeps.folder import SweepFolder
from frida_painter.sweeps.progress import SweepProgress, Tally
from frida_painter.sweeps.run import SweepRun
from frida_painter.sweeps.spec import SweepSpec

_SHOWN = 10


@dataclass(frozen=True)
class SweepStatus:
    """A sweep as its folder tells it: the runs, the records of those that are done, why others failed, by key.

    working: whether a process works on it now.
    """

    folder: Path
    spec: SweepSpec
    runs: tuple[SweepRun, ...]
    records: Mapping[str, Mapping[str, Any]]
    failures: Mapping[str, Mapping[str, Any]]
    progress: SweepProgress
    working: bool

    def lines(self) -> list[str]:
        """As a terminal shows it."""
        told = [f"{self.spec.title or self.folder.name}: {summary(self.progress, working=self.working)}"]
        told += [f"  {named(failure)}: {failure['error']}" for failure in list(self.failures.values())[:_SHOWN]]
        if len(self.failures) > _SHOWN:
            told.append(f"  and {len(self.failures) - _SHOWN} more that failed")
        return told


def status_of(folder: Path) -> SweepStatus:
    """How far the sweep in a folder is. Raises ConfigError where there is none."""
    place = SweepFolder(folder)
    spec, known, slots = place.asked()
    runs = expanded(spec, FileHashes(known, reread=False))
    tally, records, failures = Tally(runs, slots), dict[str, Any](), dict[str, Any]()
    for run in runs:
        kept = place.run(run.key)
        record = kept.record()
        if record is not None:
            records[run.key] = {**record, "labels": dict(run.labels)}
            tally.done(run, record)
        elif (failure := kept.failure()) is not None:
            failures[run.key] = failure
            tally.failed(run)
    return SweepStatus(place.path, spec, runs, records, failures, tally.progress, place.is_held)


def summary(progress: SweepProgress, *, working: bool) -> str:
    """How far it is in one sentence."""
    told = f"{progress.done} of {progress.total} runs done"
    if progress.failed:
        told += f", {progress.failed} failed"
    if progress.done + progress.failed >= progress.total:
        return f"{told}."
    if not working:
        return f"{told}, and nobody works on it; run the sweep again to continue."
    if progress.seconds_left is None:
        return f"{told}."
    return f"{told}, about {duration(progress.seconds_left)} left."


def named(failure: Mapping[str, Any]) -> str:
    """A run that failed by what tells it from the others."""
    return ", ".join(f"{name} {value}" for name, value in failure["labels"].items()) or str(failure["key"])
