"""Numbers as a person types them: what is not one is told so in a sentence."""

import typer


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
