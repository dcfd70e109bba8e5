"""Check of a plan, a painting or a sweep: can it be made again here?"""

from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory

from frida_painter import provenance
from frida_painter.errors import ConfigError
from frida_painter.plan import Plan
from frida_painter.runs.painting_folder import SETTINGS, content_hash, read_goal
from frida_painter.runs.run import PaintingRun
from frida_painter.runs.run_record import (
    NO_HASHES,
    NO_RECORD,
    RECORD,
    RecordCheck,
    RunRecord,
    compare_files,
    hash_picture,
)
from frida_painter.runs.spec import RunSpec, upgrade_record
from frida_painter_lab.experiment import Share
from frida_painter_lab.runs import RunFolder
from frida_painter_lab.sweeps.runner import hash_run, perform
from frida_painter_lab.sweeps.sweep_folder import SWEEP, SweepFolder
from frida_painter_lab.sweeps.sweep_spec import FileHashes, expand_runs


class RepeatableRun(RunRecord):
    """Record of a plan or a painting that can be made again."""

    def make_again(self) -> RecordCheck:
        """Makes it again, in this process, and compares what comes out; writes nothing. Raises FridaError.

        Nothing is made if its folder is not as it was left.
        """
        checked = self.check()
        if checked.obstacle or checked.files:
            return checked
        spec = RunSpec.of(**{**upgrade_record(self.settings), **read_goal(self.folder)})
        with PaintingRun(spec) as run:
            if self.kind == "plan":
                again = {"plan": run.plan().digest}
            else:
                again = {"painting": hash_picture(run.simulate().photograph)}
        same = all(self.results.get(name) == value for name, value in again.items())
        device = self.made_with.get("device", "cpu")
        if not same and device != "cpu":
            checked = replace(checked, differences=(*checked.differences, f"{device} does not promise equal bits"))
        return replace(checked, same=same)


@dataclass(frozen=True)
class SweepRecord:
    """Record of a sweep.

    folder: folder of the sweep
    kind: "sweep"
    made_with: versions and hashes of code that did its runs, as one line
    """

    folder: Path
    made_with: str
    kind: str = "sweep"

    def check(self) -> RecordCheck:
        """Compares versions, plug-ins, input files and the files of each run with those of the sweep."""
        here = provenance.identify_here()
        found = [] if self.made_with == here else [f"it was made with {self.made_with}, and here is {here}"]
        for name, before in SweepFolder(self.folder).read_request()[1].items():
            if (now := content_hash(Path(name))) != before:
                found.append(f"{name} {'is gone' if now == 'gone' else 'has changed'}")
        results = sorted((self.folder / "runs").glob("*/result.json"))
        changed, hashed = list[str](), True
        for result in results:
            known, place = RunFolder(self.folder, result.parent.name).record(), f"runs/{result.parent.name}"
            if known is None:
                changed.append(f"{place}/{result.name} was changed")
            elif "files" in known:
                changed += [
                    f"{place}/{told}" for told in compare_files(known["files"], hash_run(result.parent)).values()
                ]
            else:
                hashed = False
        obstacle = "" if results else "No run of it was finished."
        return RecordCheck(obstacle, tuple(found), files=tuple(changed), remark="" if hashed else NO_HASHES)

    def make_again(self) -> RecordCheck:
        """Does every finished run once more, one after another, and compares all figures and plans.

        Writes nothing into the folder. Raises FridaError.
        """
        checked = self.check()
        if not checked.can_be_made_again:
            return checked
        spec, files, _, made_with = SweepFolder(self.folder).read_request()
        with TemporaryDirectory() as elsewhere:
            for run in expand_runs(spec, FileHashes(files), made_with):
                before = RunFolder(self.folder, run.key).record()
                if before is None:
                    continue
                again = perform(Share((run,), elsewhere))
                if before["figures"] != again["figures"] or not self._has_same_plan(run.key, Path(elsewhere)):
                    told = ", ".join(f"{name} {value}" for name, value in run.labels.items()) or run.key
                    return RecordCheck(differences=(f"the run {told} came out differently",), same=False)
        return RecordCheck(same=True)

    def _has_same_plan(self, key: str, elsewhere: Path) -> bool:
        """Returns True if both runs made the same plan, or none."""
        plans = [RunFolder(sweep, key).path / "plan.json" for sweep in (self.folder, elsewhere)]
        there = [path for path in plans if path.exists()]
        return len(there) != 1 and len({Plan.load(path).digest for path in there}) <= 1


def record(folder: str | Path) -> RepeatableRun | SweepRecord:
    """Returns the record of how a plan, a painting or a sweep was made; `check` tells if it can be made again here.

    folder: of a painting, of `frida-painter plan`, or of a sweep
    Raises ConfigError if the folder holds none of these, StorageError if the record is damaged or was edited.

        >>> import frida_painter as fp
        >>> spec = fp.RunSpec.of(goal=[{"image": "photo.jpg"}], canvas="12x9cm", strokes=3, render_height=64)
        >>> with fp.PaintingRun(spec) as run:
        ...     run.plan_into("a-plan", run.plan())
        >>> str(fp.record("a-plan").check())
        'It can be made again here: nothing that decides it has changed.'
    """
    path = Path(folder)
    if path.is_file():
        path = path.parent
    if (path / SWEEP).exists():
        return SweepRecord(path, SweepFolder(path).read_request()[3])
    if (path / RECORD).exists():
        return RepeatableRun.load(path)
    if (path / SETTINGS).exists():
        return RepeatableRun(path, "painting", {}, {}, {}, {}, NO_RECORD)
    if (path / "plan.json").exists():
        return RepeatableRun(path, "plan", dict(Plan.load(path).about), {}, {}, {}, NO_RECORD)
    raise ConfigError(f"{path} holds no plan, painting or sweep; give the folder of one.")
