"""A workspace file: a person's TOML of where things stand, read whole or refused with all its faults at once."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import Any, Self

from pydantic import ValidationError

from frida_painter import storage
from frida_painter.calibration import BrushRecord, Calibration
from frida_painter.errors import ConfigError
from frida_painter.frames import CanvasSize
from frida_painter.hardware.contradictions import contradictions
from frida_painter.hardware.reach import ArmLength
from frida_painter.hardware.sections import (
    FARTHEST,
    ArmReach,
    Bounds,
    BrushHeights,
    CanvasPlace,
    PaintPlaces,
    RackPlaces,
    Section,
    Travel,
)
from frida_painter.hardware.workspace import BrushRack, Workspace

_MOST_BYTES = 2**18
_ADVICE = "`frida-painter workspace example` prints a whole one with comments"

_SECTIONS: dict[str, type[Section]] = {
    "bounds": Bounds,
    "canvas": CanvasPlace,
    "brush": BrushHeights,
    "paint": PaintPlaces,
    "rack": RackPlaces,
    "motion": Travel,
    "arm": ArmReach,
}
_OPTIONAL = ("rack", "arm")


@dataclass(frozen=True)
class WorkcellConfig:
    """What a workspace file says of one easel: its name, its workspace, its canvas, and the brush's heights there.

    touch_height, press_height: robot z in metres, for an easel whose brush was not calibrated yet;
    reach: of the arm, None where it gets everywhere within the bounds.
    """

    easel: str
    workspace: Workspace
    canvas: CanvasSize
    touch_height: float
    press_height: float
    reach: ArmLength | None = None

    def calibration(
        self,
        brush: str,
        photograph: tuple[int, int] = (720, 960),
        camera: str = "camera",
        others: Sequence[str] = (),
    ) -> Calibration:
        """The record to begin with, before any procedure was done: the canvas fills the photograph.

        others: brushes that are put into the holder later.
        """
        rows, columns = photograph
        right, bottom = columns - 1.0, rows - 1.0
        return Calibration(
            easel=self.easel,
            brush=brush,
            corners=((0.0, 0.0), (right, 0.0), (right, bottom), (0.0, bottom)),
            photograph=photograph,
            touch_height=self.touch_height,
            press_height=self.press_height,
            camera=camera,
            canvas=self.canvas,
            others={name: BrushRecord(self.touch_height, self.press_height) for name in others},
        )

    @classmethod
    def load(cls, path: Path) -> Self:
        """Reads a TOML file. Raises ConfigError naming every entry that is missing, unknown, wrong or contradictory."""
        return cls.of(storage.read_toml(path, "a workspace file (TOML)", _MOST_BYTES, _ADVICE), str(path))

    @classmethod
    def of(cls, values: dict[str, Any], name: str) -> Self:
        """The stand of these entries; `name` stands for them in messages. Raises ConfigError as `load` does."""
        faults: list[str] = []
        easel = values.get("easel")
        if "easel" not in values:
            faults.append("easel (its name) is missing")
        elif not isinstance(easel, str) or not 1 <= len(easel.strip()) <= 60 or not easel.isprintable():
            faults.append(f"easel is {_shortly(easel)}; it is a name in quotes of 1 to 60 characters")
        known = ", ".join(("easel", *(f"[{section}]" for section in _SECTIONS)))
        faults += [
            f"{_shortly(entry)} is not known; there are {known}"
            for entry in values
            if entry != "easel" and entry not in _SECTIONS
        ]
        read: dict[str, Any] = {}
        for section, model in _SECTIONS.items():
            try:
                read[section] = model.model_validate(values[section]) if section in values else None
            except ValidationError as error:
                read[section] = None
                faults += [_sentence(section, model, fault) for fault in error.errors()]
            if section not in values and section not in _OPTIONAL:
                faults.append(f"[{section}] is missing, with {', '.join(_wanted(model))}")
        faults += contradictions(
            read["bounds"], read["canvas"], read["brush"], read["paint"], read["motion"], read["rack"]
        )
        arm = read["arm"]
        if arm and not arm.nearest < arm.farthest:
            faults.append(f"arm.nearest ({arm.nearest:g} m) is not below arm.farthest ({arm.farthest:g} m)")
        if faults:
            raise ConfigError(f"{name} is no workspace: {'; '.join(faults)}. ({_ADVICE[0].upper()}{_ADVICE[1:]}.)")
        return cls._put_together(str(easel), **read)

    @classmethod
    def _put_together(
        cls,
        easel: str,
        bounds: Bounds,
        canvas: CanvasPlace,
        brush: BrushHeights,
        paint: PaintPlaces,
        rack: RackPlaces | None,
        motion: Travel,
        arm: ArmReach | None,
    ) -> Self:
        workspace = Workspace(
            lower=bounds.lower,
            upper=bounds.upper,
            canvas_origin=canvas.corner,
            canvas_angle=math.radians(canvas.turn),
            wells=paint.wells,
            water=paint.water,
            rag=paint.rag,
            rag_width=paint.rag_width,
            hover=motion.hover,
            painting_speed=motion.painting_speed,
            travel_speed=motion.travel_speed,
            home=motion.home,
            rack=BrushRack(rack.places, rack.slide, rack.lift) if rack else None,
        )
        size = CanvasSize(canvas.width, canvas.height)
        reach = ArmLength(arm.shoulder, arm.nearest, arm.farthest) if arm else None
        return cls(easel, workspace, size, brush.touch_height, brush.press_height, reach)


def example() -> str:
    """A whole workspace file with comments, to be filled with one's own measures."""
    return (resources.files("frida_painter.hardware") / "examples" / "workspace.toml").read_text(encoding="utf-8")


def _wanted(model: type[Section]) -> list[str]:
    return [name for name, field in model.model_fields.items() if field.is_required()]


def _sentence(section: str, model: type[Section], fault: Any) -> str:
    """One of pydantic's faults in plain words."""
    where = section + "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in fault["loc"])
    match fault["type"]:
        case "missing" if isinstance(fault["loc"][-1], int):
            return f"{where} is missing; {_form(fault)}"
        case "missing":
            return f"{where} is missing"
        case "extra_forbidden":
            known = ", ".join(model.model_fields)
            return f"{where[:60]} is not known; [{section}] has {known}"
        case "too_long" if fault["ctx"]["max_length"] <= 3:
            return f"{where} has more than {fault['ctx']['max_length']} numbers; {_form(fault)}"
        case "too_long":
            return f"{where} has more than {fault['ctx']['max_length']} places"
        case "dict_type":
            return f"{where} is {_shortly(fault['input'])}; it names brushes with their places, {{broad = [x, y, z]}}"
        case "too_short":
            return f"{where} is empty; name at least one place"
        case "finite_number" | "greater_than" | "greater_than_equal" | "less_than" | "less_than_equal":
            return f"{where} is {_shortly(fault['input'])}; {_range(model, fault['loc'])}"
        case "tuple_type":
            return f"{where} is {_shortly(fault['input'])}; it is a list of numbers in [ ]"
        case _ if not fault["loc"]:
            return f"{section} is {_shortly(fault['input'])}; write it as a section, [{section}]"
        case _:
            return f"{where} is {_shortly(fault['input'])}; it is a number, {_range(model, fault['loc'])}"


def _form(fault: Any) -> str:
    return "a way is [x, y]" if fault["loc"][0] == "slide" else "a place is [x, y, z]"


def _range(model: type[Section], place: tuple[Any, ...]) -> str:
    """What a number may be, in words."""
    field = model.model_fields[place[0]]
    if len(place) > 1:
        return f"allowed is from {-FARTHEST:g} to {FARTHEST:g} metres"
    bounds = {
        name: getattr(part, name) for part in field.metadata for name in ("ge", "gt", "le") if hasattr(part, name)
    }
    least = f"above {bounds['gt']:g}" if "gt" in bounds else f"from {bounds['ge']:g}"
    unit = {"turn": "degrees", "painting_speed": "m/s", "travel_speed": "m/s"}.get(place[0], "metres")
    return f"allowed is {least} to {bounds['le']:g} {unit}"


def _shortly(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= 40 else f"{text[:37]}..."
