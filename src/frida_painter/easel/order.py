"""An order of an easel: what is wanted, as it goes to the process of the easel."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Self

from pydantic import ConfigDict, TypeAdapter, ValidationError

from frida_painter.canvas_size import CanvasSize
from frida_painter.errors import ConfigError
from frida_painter.virtual.faults import NO_FAULTS, Faults
from frida_painter.virtual.table import PlacementError


@dataclass(frozen=True)
class EaselOrder:
    """Which easel is wanted, and for what: everything that its process has to know, as plain values.

    robot: by the name of a whole easel or of a real robot; canvas, seed: as
    the painting's settings say; brushes: that it is painted with, the first of them in the holder;
    state: the folder in which stops are latched and robots locked; folder:
    of the painting, where the stop file is looked for and a virtual studio keeps its diary; pace,
    placement_error, faults: of a virtual studio; canvas_picture: what is on its canvas at first, a file, None where
    that is bare; film: whether a simulated arm is filmed at work, into
    that folder, and meshes: the folder of shapes in which it is seen there, None for its own; workspace,
    camera: of a real easel, its file and its camera's name.
    """

    __pydantic_config__ = ConfigDict(extra="forbid", allow_inf_nan=False)

    robot: str
    canvas: CanvasSize
    brushes: tuple[str, ...]
    seed: int
    state: Path
    folder: Path | None = None
    pace: float = 0.0
    placement_error: PlacementError | None = None
    faults: Faults = field(default=NO_FAULTS)
    canvas_picture: Path | None = None
    workspace: Path | None = None
    camera: str = ""
    film: bool = False
    meshes: Path | None = None

    def record(self) -> dict[str, Any]:
        """The order as plain values."""
        return TypeAdapter(EaselOrder).dump_python(self, mode="json")

    @classmethod
    def of(cls, record: Mapping[str, Any]) -> Self:
        """An order from plain values. Raises ConfigError where they are none."""
        try:
            return TypeAdapter(cls).validate_python(record)
        except ValidationError as error:
            faults = "; ".join(
                f"{'.'.join(map(str, fault['loc']))}: {fault['msg'].lower()}" for fault in error.errors()
            )
            raise ConfigError(f"The order of an easel is not as it must be ({faults}).") from error
