"""`virtual`: the virtual studio, whose arm does exactly what it is told."""

from typing import TYPE_CHECKING

from frida_painter.session.easel_kind import EaselKind

if TYPE_CHECKING:
    from frida_painter.session.easel_order import EaselOrder, OpenEasel


def _open(order: "EaselOrder") -> "OpenEasel":
    from frida_painter.session.easel_kinds.studio import furnished
    from frida_painter.session.easel_order import OpenEasel
    from frida_painter.virtual.studio import FREE

    studio, easel = furnished(order, FREE)
    return OpenEasel(easel, studio.close)


KIND = EaselKind("virtual", "virtual studio", _open, simulated=True)
