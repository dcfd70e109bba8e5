"""What ImageNet's thousand classes are called: the words of WordNet for each, most usual first."""

from functools import cache
from importlib import resources

FILE = "class_names.txt"


@cache
def class_names() -> tuple[tuple[str, ...], ...]:
    """The names of each class, in the order of a classifier's scores, such as ("beacon", "lighthouse", ...).

    They are lemmas of WordNet 3.0 (Princeton University 2006), whose licence stands beside this file.
    """
    text = (resources.files(__package__) / FILE).read_text("utf-8")
    return tuple(tuple(line.split(", ")) for line in text.splitlines())


def synonyms(name: str) -> list[str]:
    """What else the classes of that name are called, as "lady beetle" for "ladybird"; nothing where there is none."""
    plain = name.lower()
    known = [some for some in class_names() if any(plain == one.lower() for one in some)]
    return [one for some in known for one in some if one.lower() != plain]
