"""The calibration record of an easel: what its procedures measured, in one checksummed file."""

from dataclasses import asdict, dataclass, field
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from frida_painter import storage
from frida_painter.errors import CalibrationError

VERSION = 1
_IDENTITY = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


@dataclass(frozen=True)
class Calibration:
    """What is known about one easel: where the camera sees the canvas, where the robot really paints.

    corners: the canvas's top-left, top-right, bottom-right and bottom-left corner in the camera's
    photograph, (column, row) pixels; photograph: its (rows, columns); placement: homography from
    where a stroke is meant to be to where the robot must be sent, canvas metres; color: affine 3 x 4
    map from perceived to true sRGB; touch_height, press_height: robot z in metres of the lightest
    touch and the hardest press; residuals: what each procedure left over, by name. Raises
    CalibrationError where a value cannot be true.
    """

    easel: str
    brush: str
    corners: tuple[tuple[float, float], ...]
    photograph: tuple[int, int]
    touch_height: float
    press_height: float
    placement: tuple[tuple[float, ...], ...] = _IDENTITY
    color: tuple[tuple[float, ...], ...] = tuple((*row, 0.0) for row in _IDENTITY)
    residuals: dict[str, float] = field(default_factory=dict)
    dated: str = field(default_factory=lambda: datetime.now(UTC).isoformat(timespec="seconds"))

    def __post_init__(self) -> None:
        corners, placement, color = np.array(self.corners), np.array(self.placement), np.array(self.color)
        if corners.shape != (4, 2) or not np.isfinite(corners).all() or _area(corners) <= 0:
            raise CalibrationError(
                f"Canvas corners {self.corners} do not go round the canvas clockwise from the top left; "
                "repeat the canvas calibration."
            )
        if placement.shape != (3, 3) or not np.isfinite(placement).all() or not np.linalg.det(placement) > 1e-6:
            raise CalibrationError("The placement homography is singular or mirrored; repeat the robot calibration.")
        if color.shape != (3, 4) or not np.isfinite(color).all():
            raise CalibrationError("The colour correction is not a finite 3 x 4 map; repeat the color calibration.")
        if not self.press_height < self.touch_height < np.inf:
            raise CalibrationError(
                f"The hardest press ({self.press_height} m) is not below the lightest touch ({self.touch_height} m); "
                "repeat the brush calibration."
            )

    def place(self, position: NDArray[np.float64]) -> NDArray[np.float64]:
        """Where to send the robot so that it paints at `position`: canvas metres [n, 2] -> [n, 2]."""
        homogeneous = np.c_[position, np.ones(len(position))] @ np.array(self.placement).T
        return homogeneous[:, :2] / homogeneous[:, 2:]

    def height(self, thickness: NDArray[np.float64]) -> NDArray[np.float64]:
        """Robot z [n] in metres for thickness [n]: 0 the lightest touch, 1 the hardest press."""
        return self.touch_height + thickness * (self.press_height - self.touch_height)

    def save(self, path: Path) -> None:
        """Writes the record, keeping the one before as `.prev`. Raises StorageError."""
        if path.exists():
            storage.write_bytes(path.with_suffix(path.suffix + ".prev"), path.read_bytes())
        storage.write_json(path, {"format": "frida-painter calibration", "version": VERSION, **asdict(self)})

    @classmethod
    def load(cls, path: Path) -> "Calibration":
        """Reads a record. Raises CalibrationError, saying what to repeat."""
        record = storage.read_json(path, "a calibration record", CalibrationError)
        if record.pop("format", None) != "frida-painter calibration" or record.pop("version", None) != VERSION:
            raise CalibrationError(f"{path} is not a calibration record of version {VERSION}; calibrate anew.")
        nested = {name: tuple(map(tuple, record.get(name, ()))) for name in ("corners", "placement", "color")}
        try:
            return cls(**{**record, **nested, "photograph": tuple(record["photograph"])})
        except (TypeError, KeyError) as cause:
            raise CalibrationError(
                f"{path} is a calibration record with a part missing ({cause}); calibrate anew."
            ) from cause


def _area(corners: NDArray[np.float64]) -> float:
    """Signed area of a polygon, positive where it runs clockwise as one sees it (rows go down)."""
    following = np.roll(corners, -1, axis=0)
    return float(np.sum(corners[:, 0] * following[:, 1] - following[:, 0] * corners[:, 1])) / 2
