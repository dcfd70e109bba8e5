"""Numbers of things and sizes of files, as a person says them."""


def count_of(number: int, what: str) -> str:
    """ "1 stroke", "2 strokes"."""
    return f"{number} {what}{'' if number == 1 else 's'}"


def megabytes(size: int) -> str:
    """Bytes as "12 MB"."""
    return f"{size / 1e6:.0f} MB"
