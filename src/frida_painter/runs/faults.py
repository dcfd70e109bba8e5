"""Faults in the description of a painting, in the words of the command line."""

from collections.abc import Mapping
from typing import Any

from pydantic.fields import FieldInfo


def sentence_on(fault: Any, fields: Mapping[str, FieldInfo]) -> str:
    """One fault of pydantic's in the words of the command line."""
    message = fault["msg"].removeprefix("Value error, ").removesuffix(".")
    if not fault["loc"]:
        return message
    field = str(fault["loc"][0])
    if fault["type"] == "extra_forbidden":
        return f"{field[:40]!r} is not a setting; there are {', '.join(sorted(fields))}"
    name = f"--{field.replace('_', '-')}"
    if fault["type"] == "value_error":
        return message if field in ("goal", "initial") or message.startswith(name) else f"{name}: {message}"
    if field not in fields or len(fault["loc"]) > 1:
        return f"{name}: {message}"
    return f"{name} was given {_shortly(fault['input'])}; it is {_allowed(fields[field])}"


def _allowed(field: FieldInfo) -> str:
    """The values that a setting may have, in words."""
    bounds = {name: getattr(part, name) for part in field.metadata for name in ("ge", "le") if hasattr(part, name)}
    choices = getattr(field.annotation, "__args__", ()) if "Literal" in str(field.annotation) else ()
    if choices:
        return f"one of {', '.join(map(str, choices))}"
    if not bounds:
        return "true or false" if field.annotation in (bool, bool | None) else "a name or a path"
    kind = "a number" if field.annotation in (float, float | None) else "a whole number"
    if "le" not in bounds:
        return f"{kind} of at least {bounds['ge']}"
    return f"{kind} from {bounds['ge']} to {bounds['le']}"


def _shortly(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= 40 else f"{text[:37]}..."
