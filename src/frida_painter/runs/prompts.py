"""What shall be painted, in words: made one plain line, or refused in a sentence."""

import re
import unicodedata

from frida_painter.errors import ConfigError

MOST = 10_000  # characters
_TITLE = 60


def read_prompt(text: str, option: str) -> str:
    """The words as one line; signs such as emoji become what they are called.

    Raises ConfigError for no words, more than 10,000 characters, control characters (an escape sequence
    of a terminal, say), and words without any Latin letter, for the networks that read them know English.
    """
    if len(text) > MOST:
        raise ConfigError(f"{option} was given {len(text)} characters; say it in at most {MOST}.")
    line = " ".join(text.split())
    if not line:
        raise ConfigError(f'{option} was given no words; say what shall be painted, such as {option} "a sailing ship".')
    bad = next((mark for mark in line if unicodedata.category(mark) in ("Cc", "Cs", "Co", "Cn")), None)
    if bad is not None:
        raise ConfigError(
            f"{option} was given a control character (U+{ord(bad):04X}), which is no word; "
            "say what shall be painted in plain words."
        )
    spoken = " ".join("".join(_spoken(mark) for mark in line).split())
    if not re.search("[A-Za-z]", unicodedata.normalize("NFKD", spoken)):
        raise ConfigError(
            f"{option} was given {line[:40]!r}, without a word in Latin letters; "
            "the networks that read it know English, so say it in English."
        )
    return spoken


def title_of(prompt: str) -> str:
    """The words as a title: their beginning where they are many."""
    short = prompt if len(prompt) <= _TITLE else f"{prompt[: _TITLE - 1].rstrip()}…"
    return short[0].upper() + short[1:]


def name_of(prompt: str) -> str:
    """The words as a name for files: small letters, digits and hyphens, at most 40 of them."""
    plain = unicodedata.normalize("NFKD", prompt).encode("ascii", "ignore").decode().lower()
    return re.sub("[^a-z0-9]+", "-", plain)[:40].strip("-") or "words"


def _spoken(mark: str) -> str:
    category = unicodedata.category(mark)
    if category == "So":
        return f" {unicodedata.name(mark, '').lower()} "
    return "" if category in ("Cf", "Mn", "Sk") and not unicodedata.combining(mark) else mark
