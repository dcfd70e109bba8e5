"""A studio's history: what was done in it, as its log tells, and how all of it is lived through again.

A studio follows from its seed and from what was done in it, so nothing of the canvas itself is kept:
the same motions leave the same paint in the same cells, byte for byte.
"""

from collections.abc import Iterable

import numpy as np
from pydantic import TypeAdapter

from frida_painter.errors import StorageError
from frida_painter.virtual.camera import VirtualCamera
from frida_painter.virtual.faults import Faults
from frida_painter.virtual.operator import StudioOperator
from frida_painter.virtual.robot import Clock, VirtualRobot
from frida_painter.virtual.simulation_log import Entry
from frida_painter.virtual.table import Table


def faults_entry(faults: Faults) -> Entry:
    """The entry that tells what goes wrong from now on."""
    return {"did": "break", "faults": TypeAdapter(Faults).dump_python(faults, mode="json")}


def relive(
    past: Iterable[Entry], clock: Clock, table: Table, robot: VirtualRobot, camera: VirtualCamera,
    operator: StudioOperator,
) -> None:  # fmt: skip
    """Brings a studio that was just opened to where its past left it.

    Raises StorageError where it does not come out as it did then: its brush or paint has changed since.
    """
    for entry in past:
        match entry["did"]:
            case "move":
                clock.now = entry["now"]
                path = np.array(entry["path"])
                table.move(path, clock.now, robot.faults)
                robot.remember(path[-1])
                if table.tuft.volume != entry["brush"]:
                    raise StorageError(
                        "The virtual studio's paint no longer does what it did when this was painted (another version "
                        "of frida-painter or of its libraries); go on with the version that began the painting."
                    )
            case "arm":
                robot.remember_arm(entry["state"])
            case "photograph":
                clock.now = entry["now"]
                camera.remember(entry["exposed"])
            case "fill":
                operator.pour(np.array(entry["color"]))
            case "tone":
                operator.tone(entry["ground"])
            case "brush":
                operator.change_brush(entry["name"])
            case "paper":
                operator.lay_paper()
            case "checker":
                x, y = entry["center"]
                operator.checker = operator.checker.laid((x, y), entry["turn"], entry["width"])
                table.checker = operator.checker if entry["lies"] else None
            case "wait":
                clock.now = entry["now"]
                table.canvas.dry_until(clock.now)
            case "break":
                robot.faults = camera.faults = TypeAdapter(Faults).validate_python(entry["faults"])
