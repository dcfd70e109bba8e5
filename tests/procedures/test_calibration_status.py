import hashlib
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest

from frida_painter.calibration import PROCEDURES, Calibration, LearnedFile
from frida_painter.canvas_size import CanvasSize
from frida_painter.errors import CalibrationError
from frida_painter.session.opening import NEEDED, OLD, require, require_basis, statuses

EASEL = Calibration(
    easel="arm 1",
    brush="broad",
    corners=((100.0, 50.0), (900.0, 60.0), (890.0, 700.0), (90.0, 690.0)),
    photograph=(760, 1024),
    touch_height=0.012,
    press_height=0.004,
    camera="webcam 3",
    canvas=CanvasSize(0.4, 0.3),
)


def renewed(record: Calibration, procedure: str, library: Path | None = None) -> Calibration:
    match procedure:
        case "canvas":
            return record.with_canvas(
                record.corners, record.photograph, camera=EASEL.camera, canvas=CanvasSize(0.4, 0.3), residual=0.3
            )
        case "robot":
            return record.with_robot(record.placement, residual=0.0004)
        case "color":
            return record.with_color(record.color, residual=1.2)
        case "brush":
            return record.with_brush(EASEL.brush, 0.012, 0.004, protrusion=None, residual=0.0005)
    assert library is not None
    return record.with_strokes(LearnedFile(str(library), hashlib.sha256(b"strokes").hexdigest()), residual=0.02)


@pytest.fixture
def library(tmp_path: Path) -> Path:
    path = tmp_path / "library.npz"
    path.write_bytes(b"strokes")
    return path


@pytest.fixture
def complete(library: Path) -> Calibration:
    record = EASEL
    for procedure in PROCEDURES:
        record = renewed(record, procedure, library)
    return record


def faulty(record: Calibration, easel: Calibration = EASEL) -> list[str]:
    return [status.procedure for status in statuses(record, easel) if status.fault]


@pytest.mark.parametrize(
    ("again", "stale"),
    [
        ("canvas", ["robot", "color", "strokes"]),
        ("robot", ["strokes"]),
        ("color", ["strokes"]),
        ("brush", ["strokes"]),
        ("strokes", []),
    ],
)
def test_what_rests_on_something_renewed_is_to_be_repeated(
    complete: Calibration, library: Path, again: str, stale: list[str]
) -> None:
    assert faulty(complete) == []
    require(complete, EASEL, PROCEDURES)
    record = renewed(complete, again, library)
    assert faulty(record) == stale
    if stale:
        with pytest.raises(CalibrationError, match=f"frida-painter calibrate {stale[0]}$"):
            require(record, EASEL)
    for procedure in stale:
        record = renewed(record, procedure, library)
    assert faulty(record) == []


def test_the_order_decides_and_not_the_clock(complete: Calibration) -> None:
    dated = {
        name: replace(done, dated=f"20{60 - done.turn}-01-01T00:00:00+00:00") for name, done in complete.done.items()
    }
    assert faulty(replace(complete, done=dated)) == []


@pytest.mark.parametrize(
    ("change", "first", "says"),
    [
        ({"camera": "webcam 4"}, ["canvas", "robot", "color", "strokes"], "camera 'webcam 3', and this is 'webcam 4'"),
        (
            {"canvas": CanvasSize(0.3, 0.2)},
            ["canvas", "robot", "color", "strokes"],
            "400 x 300 mm, and this is 300 x 200",
        ),
        ({"brush": "fine"}, ["brush", "strokes"], "broad brush, and this is fine"),
    ],
)
def test_a_foreign_part_is_to_be_repeated_with_all_that_rests_on_it(
    complete: Calibration, change: dict[str, object], first: list[str], says: str
) -> None:
    here = replace(EASEL, **change)
    assert faulty(complete, here) == first
    with pytest.raises(CalibrationError, match=f"{says}.*; repeat the .*frida-painter calibrate {first[0]}$"):
        require(complete, here, ())


def test_the_record_of_another_easel_is_refused_as_a_whole(complete: Calibration) -> None:
    with pytest.raises(CalibrationError, match=r"of easel 'arm 1', and this is 'arm 2'.*calibrate all"):
        statuses(complete, replace(EASEL, easel="arm 2"))


@pytest.mark.parametrize("missing", NEEDED)
def test_painting_needs_four_procedures(complete: Calibration, missing: str) -> None:
    record = replace(complete, done={name: done for name, done in complete.done.items() if name != missing})
    with pytest.raises(CalibrationError, match=f"{missing} calibration was never done .*calibrate {missing}$"):
        require(record, EASEL)
    require(record, EASEL, ())
    require(replace(record, done={name: complete.done[name] for name in NEEDED}), EASEL)


def test_a_lost_or_changed_library_is_found_out(complete: Calibration, library: Path) -> None:
    library.write_bytes(b"other strokes")
    assert faulty(complete) == ["strokes"]
    library.unlink()
    with pytest.raises(CalibrationError, match="gone or was changed; repeat the strokes"):
        require(complete, EASEL)


def test_what_is_old_still_holds(complete: Calibration) -> None:
    later = datetime.now(UTC) + timedelta(days=OLD + 1)
    assert all(status.is_old and not status.fault for status in statuses(complete, EASEL, later))
    assert not any(status.is_old for status in statuses(complete, EASEL))
    undated = replace(complete.done["canvas"], dated="yesterday")
    assert statuses(replace(complete, done={"canvas": undated}), EASEL)[0].days is None


def test_a_procedure_is_not_begun_on_a_basis_that_does_not_hold(complete: Calibration) -> None:
    require_basis("robot", EASEL, EASEL, defaults_hold=True)
    with pytest.raises(CalibrationError, match=r"Robot rests on canvas.*do it first: frida-painter calibrate canvas$"):
        require_basis("robot", EASEL, EASEL, defaults_hold=False)
    require_basis("canvas", EASEL, replace(EASEL, camera="webcam 4"), defaults_hold=False)
    stale = renewed(complete, "canvas")
    require_basis("robot", stale, EASEL, defaults_hold=True)
    with pytest.raises(CalibrationError, match=r"before strokes: frida-painter calibrate robot$"):
        require_basis("strokes", stale, EASEL, defaults_hold=True)
    with pytest.raises(CalibrationError, match=r"before robot: frida-painter calibrate canvas$"):
        require_basis("robot", complete, replace(EASEL, canvas=CanvasSize(0.3, 0.2)), defaults_hold=True)
