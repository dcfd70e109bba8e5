"""Brushes and stroke families as a person names them, with their shares of the strokes: "broad:60%,fine+comma:40%"."""

import re
from pathlib import Path
from typing import Any

MAX_LAYERS = 8
FAMILY_SHARE = 0.4
"""Share of the strokes that stroke families get together if none is named."""
AUTO = "auto"
"""Value that leaves a ground or brushes to the planner."""


def brush_shares(text: str) -> tuple[tuple[str, float | None], ...]:
    """Parses brushes such as "broad:60%,fine:40%"; returns names with shares in (0, 1], None without shares.

    A brush is a name or a file, which is not opened here. Raises ValueError.
    """
    found = []
    for part in text.split(","):
        name, colon, share = part.strip().rpartition(":") if part.rstrip().endswith("%") else (part.strip(), "", "")
        if not name:
            raise ValueError(f"{text[:60]!r} names no brush at one place; write broad or broad:60%,medium:40%")
        if not colon and re.fullmatch(r".+:\s*(\d[\d.]*|inf|nan)", part.strip()):
            raise ValueError(f"{part.strip()[:40]!r} is no share; write it in percent, as broad:60%,medium:40%")
        try:
            found.append((name.strip(), float(share.rstrip("%")) / 100 if colon else None))
        except ValueError as error:
            raise ValueError(
                f"the share {share[:20]!r} of {name[:40]!r} is not a number; write broad:60%,medium:40%"
            ) from error
    shares = [share for _, share in found if share is not None]
    if shares and len(shares) < len(found):
        raise ValueError("some brushes have a share and some have none; give shares to all of them or to none")
    if any(not 0 < share <= 1 for share in shares):
        raise ValueError("a share is above 0 % and at most 100 %; leave brushes out that paint nothing")
    if shares and not abs(sum(shares) - 1) <= 0.005:
        raise ValueError(f"the shares make {100 * sum(shares):g} %; together they make 100 %")
    if len(found) > MAX_LAYERS:
        raise ValueError(f"{len(found)} brushes were given; there are at most {MAX_LAYERS} layers")
    return tuple(found)


def _join(value: Any) -> Any:
    """Returns a name, a file or a list of them as one text; other values as they are."""
    several = value if isinstance(value, list | tuple) and value else [value]
    return ",".join(map(str, several)) if all(isinstance(part, str | Path) for part in several) else value


def parse_brushes(value: Any) -> Any:
    """Checks brushes from a TOML file: a text, or a list of texts."""
    value = _join(value)
    if isinstance(value, str) and value:
        names = [name for name, _ in brush_shares(value)]
        if AUTO in names and value.strip() != AUTO:
            raise ValueError(
                f"{value[:60]!r} names brushes and leaves them to the planner; write {AUTO}, or names alone"
            )
    return value


def brush_file(name: str) -> Path | None:
    """Returns the file that a brush is named by: that of its weights, or of its family ("fine+own.safetensors")."""
    source = name if Path(name).is_file() else name.rpartition("+")[2]
    return Path(source) if Path(source).suffix else None


def family_shares(text: str) -> tuple[tuple[str, float], ...]:
    """Parses families such as "comma:20%,flourish:30%"; returns names or files with shares in (0, 1).

    Without shares, they get 40 % together. Raises ValueError.
    """
    if "%" not in text:
        names = [name.strip() for name in text.split(",")]
        text = ",".join(f"{name}:{100 * FAMILY_SHARE / len(names)}%" for name in names)
    found = []
    for part in text.split(","):
        name, colon, share = part.strip().rpartition(":")
        try:
            found.append((name.strip(), float(share.rstrip("%")) / 100))
        except ValueError as error:
            raise ValueError(f"{part.strip()[:40]!r} has no share; write comma:20%,flourish:30%") from error
        if not (colon and name.strip() and "+" not in name and share.endswith("%") and found[-1][1] > 0):
            raise ValueError(f"{part.strip()[:40]!r} is no family with a share above 0 %; write comma:20%")
    if not sum(share for _, share in found) <= 1:
        raise ValueError(f"the families get {100 * sum(share for _, share in found):g} %; it is at most 100 %")
    return tuple(found)


def parse_families(value: Any) -> Any:
    """Checks families from a TOML file: a text, or a list of texts."""
    value = _join(value)
    if isinstance(value, str) and value:
        family_shares(value)
    return value
