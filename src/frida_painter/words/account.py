"""Account of a prompt: for each of its words, if the composition shows it, shows something similar, or does not."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from enum import IntEnum
from itertools import groupby

from frida_painter.words.reading import Reading, SaidWord, Thing


class Mark(IntEnum):
    """Mark of a word, from worst to best."""

    NOT_SHOWN = 0
    SIMILAR = 1
    SHOWN = 2


@dataclass(frozen=True)
class AccountLine:
    """Line of an account: a word, its mark, and the picture, place or light that shows it, or ""."""

    word: SaidWord
    mark: Mark
    by: str = ""


class Account:
    """Account of a prompt. A word counts as not shown until something that shows it is marked.

    reading: of the prompt
    """

    def __init__(self, reading: Reading) -> None:
        self._lines = {word.at: AccountLine(word, Mark.NOT_SHOWN) for word in reading.said}
        self._absent = set(reading.absent)

    def mark(self, words: Iterable[int], mark: Mark, by: str) -> None:
        """Marks words by their positions. A worse mark than the present one changes nothing."""
        for line in self._of(words):
            if mark > line.mark:
                self._lines[line.word.at] = AccountLine(line.word, mark, by)

    def mark_picture(self, thing: Thing, caption: str, *, exact: bool, several: bool) -> None:
        """Marks the words of a thing by the caption of its picture.

        The noun is shown by a picture of just that thing, and by something similar otherwise. Its colour is shown if
        the picture can have it, its number if there are as many copies, and its other words only if the caption says
        them.

        exact: True if the picture shows the noun of the thing, which may be a figure that stands for it
        several: True if one picture shows all
        """
        for word in [line.word for line in self._of(thing.at)]:
            recolored = word.lemma in thing.color.split() and " and " not in thing.color
            if word.says(caption) or (recolored and word.kind != "thing"):
                self.mark([word.at], Mark.SHOWN, caption)
            elif word.kind == "thing" or len(self._lines) == 1:
                same = exact and (word.says(thing.noun) or len(self._lines) == 1)
                self.mark([word.at], Mark.SHOWN if same else Mark.SIMILAR, repr(caption))
            elif word.kind == "number":
                is_right = thing.count == thing.shown or several
                self.mark([word.at], Mark.SHOWN if is_right else Mark.SIMILAR, f"{thing.shown} of them")

    def mark_setting(self, words: Iterable[int], name: str, said: str) -> None:
        """Marks the word `said` at these positions as shown by a place, a light or a weather of that name."""
        for word in [line.word for line in self._of(words)]:
            if said in (word.text.lower(), word.lemma) or len(self._lines) == 1:
                self.mark([word.at], Mark.SHOWN if word.says(name) else Mark.SIMILAR, name)

    def _of(self, words: Iterable[int]) -> list[AccountLine]:
        """Returns the present lines of words by their positions; none for those that do not count."""
        return [self._lines[at] for at in words if at in self._lines]

    @property
    def lines(self) -> tuple[AccountLine, ...]:
        """One line for each noun, adjective, number, verb and preposition of the prompt, in its order."""
        return tuple(self._lines[at] for at in sorted(self._lines))

    def shows(self, words: Iterable[int]) -> bool:
        """Returns True if a noun among these positions is shown, or something similar."""
        return any(line.word.kind == "thing" and line.mark > Mark.NOT_SHOWN for line in self._of(words))

    @property
    def told(self) -> str:
        """Account in words, for the terminal, the page and the record: what is shown, and what is not."""
        absent = [line for line in self.lines if line.mark is Mark.NOT_SHOWN and line.word.lemma in self._absent]
        parts = {
            "shown": [line for line in self.lines if line.mark is Mark.SHOWN],
            "shown by something similar": [line for line in self.lines if line.mark is Mark.SIMILAR],
            "not shown": [line for line in self.lines if line.mark is Mark.NOT_SHOWN and line not in absent],
            "left out as you asked": absent,
        }
        return f"Your words: {'; '.join(f'{name}: {_join(lines)}' for name, lines in parts.items() if lines)}."


def _join(lines: Iterable[AccountLine]) -> str:
    """Returns the words of lines; neighbours in the prompt that the same thing shows become one phrase."""
    told = []
    for (_, by), phrase in groupby(enumerate(lines), lambda one: (one[1].word.at - one[0], one[1].by)):
        shown = [line for _, line in phrase]
        words = repr(" ".join(line.word.text for line in shown))
        told.append(f"{words} (by {by[:60]})" if shown[0].mark is Mark.SIMILAR else words)
    return ", ".join(told)
