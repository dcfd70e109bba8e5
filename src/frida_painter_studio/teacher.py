"""Teaching of a stroke by a worker: marks become a family, the virtual studio paints it, and its marks are learned."""

import json
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory

from frida_painter import images, storage
from frida_painter.brush import FIELD
from frida_painter.brush.kinds import BrushKind, brush_kind
from frida_painter.brush.library import StrokeLibrary
from frida_painter.easel.dialogue import lead
from frida_painter.easel.virtual_easel import open_virtual_easel
from frida_painter.session.events import FamilyTaught
from frida_painter_calibration.procedures.strokes import StrokesProgress, strokes
from frida_painter_calibration.teaching.evaluation import learn
from frida_painter_calibration.teaching.families import write_family
from frida_painter_calibration.teaching.learned_pages import family_sheet
from frida_painter_calibration.teaching.marks import learn_family, read_marks
from frida_painter_calibration.teaching.training import TrainingProgress
from frida_painter_studio.jobs import TeachingRequest
from frida_painter_studio.studio_folder import PaintingFolder

_SEED = 0


def teach(request: TeachingRequest, folder: PaintingFolder, families: Path, say: Callable[[str], None]) -> FamilyTaught:
    """Learns a family, writes it into `families` with its marks and its sheet, and returns what was learned.

    say: receives the progress in words; may raise to end it.
    Raises FamilyError if the marks make no family, LibraryError if too few strokes were painted well, StorageError.
    """
    families.mkdir(exist_ok=True)
    file = families / f"{request.name}.safetensors"
    marks = file.with_suffix(".json")
    storage.write_text(marks, json.dumps({"unit": "mm", "marks": request.marks}) + "\n")
    taught = read_marks(marks)
    say("Laying the marks over each other")
    family = learn_family(taught, request.name)
    kind = brush_kind(request.brush).of_family(family)
    codes = "one shape code" if family.codes == 1 else f"{family.codes} shape codes"
    sentence = f"{len(taught)} marks, {codes}."
    if request.count == 0:
        write_family(file, family)
        sheet = family_sheet(family, taught)
        sentence += " Its strokes were not painted: the planner expects a plain ribbon."
    else:
        library = _paint(kind, request.count, folder, say)
        learned = learn(FIELD, library, kind, seed=_SEED, notify=lambda progress: say(_describe(progress)))
        learned.model.save(file)
        sheet = family_sheet(family, taught, learned.model)
        sentence += f" Learned from {len(learned.library)} strokes that the virtual studio painted."
    picture = folder.make_live_path("family", ".png")
    for place in (file.with_suffix(".png"), picture):
        images.save(sheet, place)
    return FamilyTaught(request.name, request.brush, sentence, picture.name)


def _paint(kind: BrushKind, count: int, folder: PaintingFolder, say: Callable[[str], None]) -> StrokeLibrary:
    """Returns the strokes that the virtual studio paints."""

    def hear(progress: StrokesProgress) -> None:
        say(f"The virtual studio paints strokes: {progress.done} of {count}")

    easel = open_virtual_easel(kind.name, _SEED)
    with TemporaryDirectory(dir=folder.path, prefix=storage.PART) as place:
        painting = strokes(easel, kind, Path(place) / "strokes.npz", count=count, seed=_SEED, notify=hear)
        return lead(painting, lambda question: question.proposal or False).library


def _describe(progress: TrainingProgress) -> str:
    return f"Learning how they look: {progress.epoch} of {progress.epochs}"
