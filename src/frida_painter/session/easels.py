"""The easels there are, by name: what is wanted of one, and how it is opened.

A machine joins with one line in `OPENERS`; everything else, its process, stop, latch and lock, is the
same for all.
"""

import hashlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Self

from pydantic import ConfigDict, TypeAdapter, ValidationError

from frida_painter.errors import ConfigError
from frida_painter.frames import CanvasSize
from frida_painter.hardware.easel import Easel
from frida_painter.virtual.faults import NO_FAULTS, Faults
from frida_painter.virtual.studio import StudioSettings, open_studio
from frida_painter.virtual.table import PlacementError

DIARY = "studio.diary"
STOP_FILE = "stop"


@dataclass(frozen=True)
class EaselOrder:
    """Which easel is wanted, and for what: everything that its process has to know, as plain values.

    robot: its name in `OPENERS`; canvas, brush, seed: as the painting's settings say; state: the folder
    in which stops are latched and robots locked; folder: of the painting, where the stop file is looked
    for and a virtual studio keeps its diary; pace, placement_error, faults: of a virtual studio.
    """

    __pydantic_config__ = ConfigDict(extra="forbid", allow_inf_nan=False)

    robot: str
    canvas: CanvasSize
    brush: str
    seed: int
    state: Path
    folder: Path | None = None
    pace: float = 0.0
    placement_error: PlacementError | None = None
    faults: Faults = field(default=NO_FAULTS)

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


@dataclass(frozen=True)
class OpenEasel:
    """An easel that is open. close: ends what is beyond robot and camera, such as a diary; may raise StorageError."""

    easel: Easel
    close: Callable[[], None]


def open_easel(order: EaselOrder) -> OpenEasel:
    """Opens the easel of that name; its robot and camera are not connected yet. Raises ConfigError and StorageError."""
    if order.robot not in OPENERS:
        raise ConfigError(f"There is no robot {order.robot!r}; take {', '.join(OPENERS)}.")
    return OPENERS[order.robot](order)


def machine(order: EaselOrder) -> str | None:
    """A name for what only one process may have at a time; None where nobody else could know of it.

    Of a simulated machine that is the world of one painting, of a real one the machine.
    """
    if order.robot in SIMULATED:
        return None if order.folder is None else f"the {order.robot} studio of {order.folder.resolve()}"
    return order.robot


def lock_path(state: Path, name: str) -> Path:
    """Where the lock of the machine of that name is kept."""
    return state / "locks" / f"{hashlib.sha256(name.encode()).hexdigest()[:16]}.lock"


def _open_virtual(order: EaselOrder) -> OpenEasel:
    studio = open_studio(
        order.canvas,
        order.brush,
        seed=order.seed,
        settings=StudioSettings(placement_error=order.placement_error, pace=order.pace, faults=order.faults),
        state=None if order.folder is None else order.folder / DIARY,
    )
    return OpenEasel(studio.easel, studio.close)


OPENERS: Mapping[str, Callable[[EaselOrder], OpenEasel]] = {"virtual": _open_virtual}
SIMULATED = frozenset({"virtual"})
