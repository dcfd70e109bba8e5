"""Check of a plan or a painting: can it be made again here?"""

from dataclasses import replace
from pathlib import Path

from frida_painter.errors import ConfigError
from frida_painter.runs.painting_folder import (
    NO_RECORD,
    RECORD,
    SETTINGS,
    RecordCheck,
    RunRecord,
    hash_picture,
    read_goal,
)
from frida_painter.runs.run import PaintingRun
from frida_painter.runs.spec import RunSpec, upgrade_record
from frida_painter.strokes.plan import Plan


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
            again = (
                {"plan": run.plan().digest}
                if self.kind == "plan"
                else {"painting": hash_picture(run.simulate().photograph)}
            )
        same = all(self.results.get(name) == value for name, value in again.items())
        if not same and (device := self.made_with.get("device", "cpu")) != "cpu":
            checked = replace(checked, differences=(*checked.differences, f"{device} does not promise equal bits"))
        return replace(checked, same=same)


def record(folder: str | Path) -> RepeatableRun:
    """Returns the record of how a plan or a painting was made; `check` tells if it can be made again here.

    folder: of a painting, or of `frida-painter plan`
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
    if (path / RECORD).exists():
        return RepeatableRun.load(path)
    if (path / SETTINGS).exists():
        return RepeatableRun(path, "painting", {}, {}, {}, {}, NO_RECORD)
    if (path / "plan.json").exists():
        return RepeatableRun(path, "plan", dict(Plan.load(path).about), {}, {}, {}, NO_RECORD)
    raise ConfigError(f"{path} holds no plan and no painting; give the folder of one.")
