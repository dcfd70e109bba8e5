"""The worker's part of calibrating: leads the procedures, asks on the page, and keeps the easel's record."""

import secrets
import shutil
from dataclasses import replace

from frida_painter import images, storage
from frida_painter.brush.kinds import brush_kind
from frida_painter.calibration import Calibration
from frida_painter.hardware.easel import Easel
from frida_painter.runs.calibrating import (
    CalibrationSetup,
    begin_procedure,
    easel_of,
    learn_from,
    record_to_renew,
)
from frida_painter.runs.easel import with_operator
from frida_painter.session.page_events import CalibrationStatus, ProcedureBegan, ProcedureFound, ProcedureProgress
from frida_painter.session.procedures.calibration_status import require_basis, statuses
from frida_painter.session.procedures.dialogue import Finding, lead
from frida_painter.session.procedures.strokes import StrokesFinding
from frida_painter.web.calibration_request import CalibrationRequest
from frida_painter.web.feed import Feed
from frida_painter.web.job import Job


def calibrate(job: Job) -> None:
    """Does what was asked for in the folder, one procedure after another; what is done is kept at once."""
    request, folder = CalibrationRequest.kept(job.folder), job.folder.painting
    shutil.rmtree(folder, ignore_errors=True)  # the world in which was calibrated before
    storage.new_folder(folder)
    spec = job.spec_to_calibrate(request)
    with easel_of(spec, folder, job.state) as easel:
        here = with_operator(easel, spec, job.asker.answer)
        try:
            job.stop.then(here.robot.stop)
            here.robot.connect()
            here.camera.connect()
            _lead_all(job, request, here)
        finally:
            here.camera.close()
            here.robot.close()


def _lead_all(job: Job, request: CalibrationRequest, here: Easel) -> None:
    path, feed = job.easel.record, job.feed
    known = record_to_renew(path, here.calibration, anew=request.whole)
    _tell_status(feed, known, here.calibration)

    def say(words: str) -> None:
        feed.tell(ProcedureProgress(words))
        job.stop.heed()

    for name in request.what:
        require_basis(name, known, here.calibration, defaults_hold=here.simulated)
        feed.tell(ProcedureBegan(name))
        easel = replace(here, calibration=known)
        setup = CalibrationSetup(easel, brush_kind(request.brush), path, request.seed, request.count, say)
        finding = lead(begin_procedure(name, setup), job.asker.answer)
        known = finding.enter(known)
        if isinstance(finding, StrokesFinding):
            known = learn_from(finding, setup, known)
        known.save(path)
        feed.tell(ProcedureFound(name, _sentence(finding), _shown(name, finding, setup, job)))
        _tell_status(feed, known, here.calibration)


def _sentence(finding: Finding) -> str:
    """What was found, without where files are."""
    file = getattr(finding, "file", None)
    return finding.sentence if file is None else finding.sentence.replace(f": {file.path}", "")


def _shown(name: str, finding: Finding, setup: CalibrationSetup, job: Job) -> str | None:
    """The finding's picture, beside the record for good and where the page sees it."""
    if finding.picture is None:
        return None
    images.save(finding.picture, setup.beside(name, "png"))
    for before in job.folder.live.glob(f"found-{name}-*.png"):
        before.unlink()
    shown = f"found-{name}-{secrets.token_hex(12)}.png"  # whoever knows its name may see it: it is not to be guessed
    images.save(finding.picture, job.folder.live / shown)
    return shown


def _tell_status(feed: Feed, record: Calibration, easel: Calibration) -> None:
    """Tells the status of every procedure."""
    procedures = [
        {
            "name": status.procedure,
            "dated": None if status.done is None else status.done.dated[:10],
            "fault": status.fault,
            "old": status.is_old,
        }
        for status in statuses(record, easel)
    ]
    feed.tell(CalibrationStatus(easel.easel, procedures))
