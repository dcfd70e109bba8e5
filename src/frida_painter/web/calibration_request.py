"""What is to be calibrated, as a person asks for it on the page."""

from typing import Annotated, Literal, Self, get_args

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from frida_painter import storage
from frida_painter.errors import StorageError
from frida_painter.web.folder import PaintingFolder

Procedure = Literal["canvas", "robot", "color", "brush", "strokes"]
PROCEDURES: tuple[Procedure, ...] = get_args(Procedure)
_FILE = "asked.json"
_Side = Annotated[float, Field(ge=60, le=2000, allow_inf_nan=False)]


class CalibrationRequest(BaseModel):
    """What is to be found out, in which order; for a simulated easel: its canvas in mm, brush and seed as well.

    count: how many strokes the strokes procedure paints and learns from.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    what: tuple[Procedure, ...] = Field(min_length=1, max_length=5)
    brush: Literal["fine", "medium", "broad"] = "broad"
    width: _Side = 14 * 25.4
    height: _Side = 11 * 25.4
    seed: int = Field(0, ge=0, le=2**31 - 1)
    count: int = Field(60, ge=20, le=1000)

    @model_validator(mode="after")
    def _once_and_in_order(self) -> Self:
        if list(self.what) != [name for name in PROCEDURES if name in self.what]:
            raise ValueError("Each procedure is done once, in the order canvas, robot, color, brush, strokes.")
        return self

    @property
    def whole(self) -> bool:
        """Whether all is done anew."""
        return self.what == PROCEDURES

    def keep(self, folder: PaintingFolder) -> None:
        """Puts it into the folder, for the worker. Raises StorageError."""
        storage.write_json(folder.path / _FILE, {"asked": self.model_dump(mode="json")})

    @classmethod
    def kept(cls, folder: PaintingFolder) -> Self:
        """What was asked for in that folder. Raises StorageError."""
        record = storage.read_json(folder.path / _FILE, "what is to be calibrated")
        try:
            return cls.model_validate(record["asked"])
        except (KeyError, ValidationError) as cause:
            raise StorageError("What was asked to be calibrated is damaged; ask again.") from cause
