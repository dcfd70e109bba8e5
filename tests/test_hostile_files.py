"""Files with a right checksum and wrong values: each is read, or refused in a sentence; nothing else is raised."""

import contextlib
import copy
import json
import tomllib
from collections.abc import Callable, Iterator
from datetime import UTC, datetime
from itertools import count
from pathlib import Path
from typing import Any

import pytest
import torch

from frida_painter.canvas_size import CanvasSize
from frida_painter.errors import FridaError, StorageError
from frida_painter.hardware.preset import find_preset
from frida_painter.hardware.workcell import WorkcellConfig, example
from frida_painter.mixing.recipe import PaintSet
from frida_painter.perception import flatfield
from frida_painter.perception.color import read_palette
from frida_painter.planning.placement import Placement
from frida_painter.runs import look_folder, painting_folder, reopening
from frida_painter.runs.goal_item import read_goal_file
from frida_painter.runs.painting_easel import order
from frida_painter.runs.painting_folder import RunRecord
from frida_painter.runs.spec import RunSpec
from frida_painter.session import resuming
from frida_painter.session.events import (
    BrushInHand,
    CanvasPicture,
    CommandDone,
    DrawnRegion,
    Drying,
    MotionBegan,
    NewGoal,
    PaintingBegun,
    PlanAdopted,
    StrokeLeftOut,
    StrokeOfPerson,
    StrokePainted,
    record,
)  # fmt: skip
from frida_painter.session.fold import FORMAT, VERSION
from frida_painter.session.opening import load_record
from frida_painter.strokes.plan import Plan
from frida_painter.system import event_log, images, storage
from frida_painter.system.event_log import FEED, EventLog, LogReader
from frida_painter_calibration.machine_setup import MachineSetup
from frida_painter_calibration.teaching.marks import read_marks
from frida_painter_cli import commands
from frida_painter_lab.sweeps.sweep_spec import SweepFolder, SweepSpec
from support.plans import made_up_plan

HOSTILE = (None, True, -1, 2**62, 1e300, "", "\0", "\ud800", "a" * 5000, [], {}, [None], {"a": 1}, [[1.0]])
GONE = object()


def places(value: Any, at: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    parts = value.items() if isinstance(value, dict) else enumerate(value[:2]) if isinstance(value, list) else ()
    for name, part in parts:
        yield (*at, name)
        yield from places(part, (*at, name))


def spoilt(value: Any, each: int) -> Iterator[Any]:
    """The value with `each` hostile values, in turn, in the place of each of its parts."""
    turn = count()
    for at in places(value):
        for _ in range(each):
            new = (*HOSTILE, GONE)[next(turn) % (len(HOSTILE) + 1)]
            changed = copy.deepcopy(value)
            inner = changed
            for name in at[:-1]:
                inner = inner[name]
            if new is GONE:
                del inner[at[-1]]
            else:
                inner[at[-1]] = new
            yield changed


def survive(variants: Iterator[Any], write: Callable[[Any], None], read: Callable[[], object]) -> None:
    read()
    for value in variants:
        write(value)
        try:
            read()
        except FridaError as refusal:
            assert "\n" not in str(refusal).removesuffix("\n") or "Since this painting" in str(refusal)


def resume(folder: Path) -> None:
    """Reads everything of a painting's folder that resuming reads before an easel is opened."""
    found = reopening.reopen(folder, accept_changes=True, pace=0.0)
    with contextlib.closing(found.journal):
        known = found.history
        resuming.light(known)
        resuming.load_photograph(folder, known.pictures.last)
        resuming.region(folder, known)
        resuming.load_canvas(folder, known.pictures.last, known, found.spec.canvas, folder / "calibration.json")
        known.progress.wet(datetime.now(UTC))
        if found.plan is not None:
            found.plan.plan.part(slice(found.plan.planning.done, known.progress.painted))
        order(found.spec, found.spec.brush_names, folder)
        painting_folder.are_there(folder, 6)


@pytest.fixture
def painting(tmp_path: Path) -> Path:
    """The folder of a painting that broke off after its second stroke, as far as resuming reads it."""
    images.save(torch.rand(3, 30, 40), tmp_path / "photo.png")
    folder = tmp_path / "painting"
    folder.mkdir()
    plan = made_up_plan(6, 2)
    plan.save(folder / "plan.json")
    spec = RunSpec.of(goal=[{"image": tmp_path / "photo.png"}], strokes=6, studio_canvas=tmp_path / "photo.png")
    painting_folder.keep_goal(spec, folder)
    (folder / painting_folder.SETTINGS).write_text(json.dumps(spec.record()))
    images.save(torch.rand(3, 30, 40), folder / "look.png")
    images.save(torch.rand(3, 30, 40), folder / "regions" / "look.png")
    storage.write_json(folder / "result.json", {"strokes_painted": 2, "strokes_given_up": [1], "stopped": False})
    known = Placement.unknown({"fine": 0.01})
    touch = dict(known.touch.depths), known.touch.lower, known.touch.information
    events = (
        PaintingBegun(spec.record(), painting_folder.input_hashes(spec, folder)),
        CanvasPicture("look.png", 0, light=[[0.5] * len(flatfield._PAIRS)] * 3),
        PlanAdopted(plan.digest, 0, "look.png", known.error, known.information, *touch),
        *(MotionBegan(("stroke 1",), 1), StrokePainted(1, 6), MotionBegan(("stroke 2",), 2), StrokeLeftOut(2, 6)),
        *(CanvasPicture("look.png", 2, "person"), CanvasPicture("look.png", 2, "renderer"), Drying(2, 30.0)),
        *(BrushInHand("fine"), CommandDone(DrawnRegion("look.png")), CommandDone(NewGoal("", {}))),
        *(StrokeOfPerson(1, {}, (0.0, 0.0, 0.0), painted) for painted in (False, True)),
    )
    first, *others = (json.loads(json.dumps(record(event))) for event in events)
    EventLog.write(folder / "journal", [{"format": FORMAT, "version": VERSION, **first}, *others])
    return folder


def test_a_painting_with_any_wrong_value_is_resumed_or_refused(painting: Path) -> None:
    settings, journal = painting / "settings.json", EventLog.read(painting / "journal")
    kept = json.loads(settings.read_text())
    survive(spoilt(kept, 3), lambda value: settings.write_text(json.dumps(value)), lambda: resume(painting))
    settings.write_text(json.dumps(kept))

    def write(records: list[dict[str, Any]]) -> None:
        EventLog.write(painting / "journal", records)

    changed = (
        [*journal[:number], value, *journal[number + 1 :]]
        for number, one in enumerate(journal)
        for value in spoilt({**one, "settings": {}} if number == 0 else one, 4)
    )
    survive(changed, write, lambda: resume(painting))
    write(journal)
    result = painting / "result.json"
    survive(
        spoilt(storage.read_json(result, "it"), 15),
        lambda value: storage.write_json(result, value),
        lambda: painting_folder.are_there(painting, 6),
    )


@pytest.mark.parametrize(
    "content", [b"{]}", b'{"a": ' + b"[" * 10**5 + b"]" * 10**5 + b"}", b'{"a": 1e999}', b'{"a": NaN}']
)
def test_a_journal_with_right_checksums_and_no_records_is_refused_and_kept(painting: Path, content: bytes) -> None:
    path = painting / "journal"
    *lines, last = path.read_bytes().splitlines(keepends=True)
    for before in (b"".join([*lines, last]), lines[0]):  # as the last line, and as another
        link = before.splitlines()[-1][:16]
        bad = b"%s %d %s\n" % (event_log._line_checksum(link, content), len(content), content)
        path.write_bytes(before + bad)
        with pytest.raises(StorageError, match="journal"):
            resume(painting)
        assert path.read_bytes() == before + bad
    EventLog.write(painting / "feed", [{"event": 1}])
    good = (painting / "feed").read_bytes()
    (painting / "feed").write_bytes(
        good + b"%s %d %s\n" % (event_log._line_checksum(good[:16], content), len(content), content)
    )
    assert LogReader(painting / "feed").read() == EventLog.read(painting / "feed", FEED) == [{"event": 1}]


def test_a_zero_byte_in_the_settings_is_one_sentence(painting: Path, monkeypatch, capsys) -> None:
    settings = painting / "settings.json"
    settings.write_text(json.dumps({**json.loads(settings.read_text()), "studio_canvas": "\0"}))
    monkeypatch.setattr("sys.argv", ["frida-painter", "resume", str(painting), "--yes"])
    with pytest.raises(SystemExit) as end:
        commands.main()
    told = capsys.readouterr().err
    assert end.value.code == 2 and told.count("\n") == 1 and "studio_canvas" in told


def test_records_with_any_wrong_value_are_read_or_refused(painting: Path, tmp_path: Path) -> None:
    spec = painting_folder.read_spec(painting)
    RunRecord.begin(painting, "plan", spec, ("fine",), "cpu").finish(plan="x")
    (tmp_path / "place.toml").write_text(example())
    place = WorkcellConfig.load(tmp_path / "place.toml").calibration("fine", others=["broad"])
    place.save(tmp_path / "record.json")
    setup = MachineSetup.begin(
        tmp_path, find_preset("grbl-router"), "grbl-router", "/dev/x", "my easel", "fine", CanvasSize(0.1, 0.1)
    )
    setup.save()
    sweep = SweepFolder(tmp_path)
    settings = {"image": str(tmp_path / "photo.png"), "strokes": 5}
    sweep.keep(SweepSpec.of(settings=settings, grid={"seed": [0, 1]}), {"a": "b"}, 1)
    corners = look_folder._corners_file(tmp_path / "photo.png")
    storage.write_json(corners, {"corners": [[0, 0], [1, 0], [1, 1], [0, 1]]})
    readers = {
        painting / "plan.json": lambda: Plan.load(painting),
        painting / "record.json": lambda: RunRecord.load(painting).check(),
        tmp_path / "record.json": lambda: load_record(tmp_path / "record.json", place),
        tmp_path / "setup.json": lambda: MachineSetup.resume(tmp_path).robot,
        tmp_path / "sweep.json": sweep.read_request,
        corners: lambda: look_folder._read_corners(tmp_path / "photo.png"),
    }
    for path, read in readers.items():
        kept = storage.read_json(path, "it")
        survive(spoilt(kept, 2), lambda value, path=path: storage.write_json(path, value), read)


def test_what_a_person_writes_is_read_or_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    images.save(torch.rand(3, 30, 40), tmp_path / "p.png")
    path = tmp_path / "a.toml"
    path.write_text("")
    workspace, given = tomllib.loads(example()), dict[str, Any]()
    monkeypatch.setattr(storage.tomllib, "loads", lambda text: given["value"])
    paint = {"name": "a", "color": "#773849", "tint": "#e9b5da", "white": 10}
    goal = {"image": "p.png", "weight": 1.0, "crop": [0.0, 0.0, 1.0, 1.0]}
    settings = {"goal": [goal], "strokes": 5, "brushes": ["fine"], "paints": "any", "title": "x", "canvas": "3x4cm",
                "studio_canvas": "p.png", "replan_policy": "times:3", "ground": "#ffffff"}  # fmt: skip
    readers: tuple[tuple[Any, Callable[[], object]], ...] = (
        (workspace, lambda: WorkcellConfig.load(path).calibration("fine")),
        ({"finish": "matte", "mixer": "kubelka-munk", "paint": [paint, {"name": "titanium white"}]},
         lambda: PaintSet.of(path)),
        ({"goal": [goal, {"text": "a cat"}], "initial": [goal]}, lambda: RunSpec.of(strokes=5, **read_goal_file(path))),
        (settings, lambda: RunSpec.from_toml(path).record()),
        ({"settings": {"image": "p.png"}, "grid": {"seed": [0]}, "runs": [{"effort": 0.5}]},
         lambda: [*SweepSpec.from_toml(path).fields()]),
    )  # fmt: skip
    for value, read in readers:
        given["value"] = value
        survive(spoilt(value, 2), lambda changed: given.update(value=changed), read)
    marks = {"unit": "cm", "marks": [{name: [0.2, 0.4, 0.6, 0.8] for name in ("x", "y", "pressure", "time")}]}
    path = path.with_suffix(".json")
    palette = {"paints": ["#ffffff", "#000000"]}
    for value, read in ((palette, lambda: read_palette(path, None)), (marks, lambda: read_marks(path))):
        path.write_text(json.dumps(value))
        survive(spoilt(value, 8), lambda changed: path.write_text(json.dumps(changed)), read)
