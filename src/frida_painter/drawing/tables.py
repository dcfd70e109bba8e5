"""Tables: text files with one fact a line, each in the room that uses it."""

from importlib import resources


def read_lines(file: str) -> list[str]:
    """Returns the lines of a table such as "words/world.txt", without empty ones and comments."""
    lines = (resources.files("frida_painter") / file).read_text("utf-8").splitlines()
    return [line for line in lines if line and not line.startswith("#")]


def read_rows(file: str) -> list[list[str]]:
    """Returns the rows of a table, split at each "|"."""
    return [[part.strip() for part in line.split("|")] for line in read_lines(file)]


def split_words(said: str) -> tuple[str, ...]:
    """Returns the words of a list with commas; none for an empty one."""
    return tuple(said.split(", ")) if said else ()
