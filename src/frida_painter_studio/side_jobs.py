"""Jobs of a worker beside paintings: pictures that an allowed maker makes of words, and a stroke that is taught."""

import json
import re
import secrets
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory

from frida_painter.brush import FIELD
from frida_painter.brush.kinds import brush_kind
from frida_painter.canvas_size import CanvasSize
from frida_painter.easel.dialogue import lead
from frida_painter.easel.kinds import LIVE
from frida_painter.easel.virtual_easel import open_virtual_easel
from frida_painter.errors import Interrupted
from frida_painter.runs.spec import RunSpec
from frida_painter.session.events import CommandDone, ResultFound
from frida_painter.system import images, storage
from frida_painter_calibration.procedures.strokes import StrokesProgress, strokes
from frida_painter_calibration.teaching.evaluation import learn
from frida_painter_calibration.teaching.families import write_family
from frida_painter_calibration.teaching.learned_pages import family_sheet
from frida_painter_calibration.teaching.marks import learn_family, read_marks
from frida_painter_calibration.teaching.training import TrainingProgress
from frida_painter_studio.at_page import Feed, StopWatch
from frida_painter_studio.jobs import TeachingRequest
from frida_painter_studio.picture_choosing import MADE, MAX_MAKINGS
from frida_painter_studio.studio_folder import PaintingFolder
from frida_painter_together.inbox import MakingOrder, make_live_path
from frida_painter_together.proposing import record_making, show_pictures, without_folders
from frida_painter_words.picture_makers.making import MAX_PICTURES, MakingWish, make_pictures, remove_making

_SEED = 0


def imagine(folder: PaintingFolder, feed: Feed, stop: StopWatch) -> None:
    """Makes the requested pictures, and tells the page; a stop ends the maker with all that it started.

    Raises StopPressed, MakingFailed, ConfigError and StorageError.
    """
    order = MakingOrder.load(folder.path)
    size = CanvasSize(order.width / 1000, order.height / 1000)
    spec = RunSpec.of(goal=[{"text": order.words}], seed=order.seed, canvas=size)
    place = folder.path / MADE / secrets.token_hex(12)  # random, because everybody who knows a name may see the picture
    place.parent.mkdir(exist_ok=True)
    _forget_old(folder)
    try:
        wish = MakingWish(order.words, order.maker, minutes=order.minutes)
        making = make_pictures(wish, place, spec, stop_asked=lambda: stop.asked, tell=feed.say)
    except Interrupted:
        stop.heed()
        raise
    shown = show_pictures(making, folder.path / LIVE, place.name)
    feed.tell(CommandDone(record_making(without_folders(making), order.label, place.parent, shown)))


def _forget_old(folder: PaintingFolder) -> None:
    """Removes the oldest makings. The page shows the newest ones, and the one that begins now."""
    makings = (place for place in (folder.path / MADE).iterdir() if re.fullmatch("[0-9a-f]{24}", place.name))
    for place in sorted(makings, key=lambda place: place.stat().st_mtime)[: -(MAX_MAKINGS - 1)]:
        for number in range(1, MAX_PICTURES + 1):
            (folder.path / LIVE / f"made-{place.name}-{number}.jpg").unlink(missing_ok=True)
        remove_making(place)


def teach(request: TeachingRequest, folder: PaintingFolder, families: Path, say: Callable[[str], None]) -> ResultFound:
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

        def tell_strokes(progress: StrokesProgress) -> None:
            say(f"The virtual studio paints strokes: {progress.done} of {request.count}")

        def tell_training(progress: TrainingProgress) -> None:
            say(f"Learning how they look: {progress.epoch} of {progress.epochs}")

        easel = open_virtual_easel(kind.name, _SEED)
        with TemporaryDirectory(dir=folder.path, prefix=storage.PART) as scratch:
            file_of_strokes = Path(scratch) / "strokes.npz"
            painting = strokes(easel, kind, file_of_strokes, count=request.count, seed=_SEED, notify=tell_strokes)
            library = lead(painting, lambda question: question.proposal or False).library
        learned = learn(FIELD, library, kind, seed=_SEED, notify=tell_training)
        learned.model.save(file)
        sheet = family_sheet(family, taught, learned.model)
        sentence += f" Learned from {len(learned.library)} strokes that the virtual studio painted."
    picture = make_live_path(folder.path, "family", ".png")
    for place in (file.with_suffix(".png"), picture):
        images.save(sheet, place)
    told = {"brush": request.brush, "sentence": sentence, "picture": picture.name}
    return ResultFound("family", request.name, detail=told)
