"""What a painting learned of its easel is kept in the calibration record, for the next painting."""

from pathlib import Path

from frida_painter.calibration import Calibration
from frida_painter.planning.placement import Placement
from frida_painter.runs.spec import RunSpec
from frida_painter.session.painting import Painting


def keep_learned(spec: RunSpec, begun: Calibration | None, learned: Placement, painting: Painting) -> Path | None:
    """Writes into the record that a finished painting went by where strokes land and brushes touch; the record then.

    begun: it as the painting began. Where it was changed meanwhile it stays: whoever calibrated anew knows better. The
    record before is kept beside it, as Calibration.save does. Raises CalibrationError and StorageError.
    """
    record, finished = spec.calibration, painting.rest is not None and len(painting.rest) == 0
    if record is None or begun is None or spec.by_hand or not finished or Calibration.load(record) != begun:
        return None
    learned.corrected(begun, spec.canvas).save(record)
    return record
