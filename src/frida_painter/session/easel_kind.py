"""Kinds of whole easels: a simulated studio, or a person's hand, with all that stands around it."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

from frida_painter.hardware.kinds import Needed

if TYPE_CHECKING:  # the page knows of easels without what computes them
    from frida_painter.hardware.easel import Easel
    from frida_painter.session.easel_order import EaselOrder


@dataclass(frozen=True)
class OpenEasel:
    """An easel that is open. close: ends what is beyond robot and camera, such as a diary; may raise StorageError."""

    easel: "Easel"
    close: Callable[[], None]


@dataclass(frozen=True)
class EaselKind:
    """A kind of easel that knows its own workspace and calibration, and its own camera where it is simulated.

    name: by which it is registered, and as it is written after --robot; title: what people call it; open: opens
    what is ordered, with robot and camera not connected yet, and raises ConfigError and StorageError;
    simulated: whether no real machine is moved; person: whether somebody paints by hand; needed: what has to be
    installed for it; load: loads and compiles what it computes with, before anybody knows what is ordered. The module
    that holds one imports what computes inside `open` and `load`.
    """

    name: str
    title: str
    open: "Callable[[EaselOrder], OpenEasel]"
    simulated: bool
    person: bool = False
    needed: Needed | None = None
    load: Callable[[], None] = lambda: None
