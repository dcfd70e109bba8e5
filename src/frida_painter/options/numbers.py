"""Numbers as a person types them: what is not one is told so in a sentence."""

from collections.abc import Callable

import typer


def whole_number_within(least: int, most: int) -> Callable[[str], int]:
    """Reads whole numbers from `least` to `most`. What it makes raises typer.BadParameter."""

    def read(text: str) -> int:
        value = whole_number(text)
        if not least <= value <= most:
            raise typer.BadParameter(f"{value} is not from {least} to {most}")
        return value

    return read


def whole_number(text: str) -> int:
    """ "300" as 300. Raises typer.BadParameter."""
    try:
        return int(text)
    except ValueError as error:
        raise typer.BadParameter(f"{str(text)[:40]!r} is not a whole number, like 300") from error


def number(text: str) -> float:
    """ "0.5" as 0.5. Raises typer.BadParameter."""
    try:
        return float(text)
    except ValueError as error:
        raise typer.BadParameter(f"{str(text)[:40]!r} is not a number, like 0.5") from error


def count_of(number: int, what: str) -> str:
    """ "1 stroke", "2 strokes"."""
    return f"{number} {what}{'' if number == 1 else 's'}"


def megabytes(size: int) -> str:
    """Bytes as "12 MB"."""
    return f"{size / 1e6:.0f} MB"
