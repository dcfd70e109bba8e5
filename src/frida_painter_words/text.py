"""The goal kind `text`: words that say what to paint."""

from __future__ import annotations

import re
import unicodedata
from dataclasses import dataclass, replace

from frida_painter.errors import ConfigError
from frida_painter.objectives.objective import (
    Goal,
    ObjectiveContext,
    ObjectiveTerm,
    Term,
    require_weight,
)
from frida_painter.objectives.word_settings import USUAL, WordSettings, refuse_absent
from frida_painter_words.reading import LONGEST, contents, split_absent

_HELD_OUT = 7919  # added to the seed of views by which a CLIP judges what it has optimised


@dataclass(frozen=True)
class TextTerm(Term):
    """Term for words: `prompt` is one line with at least one Latin letter. Raises ConfigError otherwise, and for
    words that plainly say only what must not be seen: no network paints the absence of a thing.
    """

    prompt: str
    weight: float = 1.0
    settings: WordSettings = USUAL
    interpretation_order = 2
    is_tried = False

    def __post_init__(self) -> None:
        require_weight(self.weight, "words")
        if not self.prompt.strip():
            raise ConfigError("Words to paint were given that are empty; say what shall be painted.")
        if not re.search("[A-Za-z]", unicodedata.normalize("NFKD", self.prompt)):
            raise ConfigError(f"{self.prompt[:40]!r} has no word in Latin letters; say it in English.")
        rest, absent = split_absent(self.prompt[:LONGEST])
        if absent and not contents(rest):
            raise refuse_absent(self.prompt)

    @property
    def words(self) -> str:
        """The prompt."""
        return self.prompt

    def say(self, settings: WordSettings) -> TextTerm:
        """Returns the term with these settings of its words."""
        return replace(self, settings=settings)

    def prepare(self, context: ObjectiveContext) -> ObjectiveTerm:
        """Returns the text objective of the prompt, by a CLIP. Raises WeightsError without one.

        A CLIP validates itself what it has optimised, in views that the optimiser never sees.
        """
        from frida_painter.objectives.text_loss import Sight, Text

        reader = context.encoders.reader()
        if not reader.reads_all(self.prompt):
            context.encoders.remark(f"The words {self.prompt[:40]!r}... are too many; the last were cut off.")
        if not self.settings.avoid and (absent := " ".join(split_absent(self.prompt)[1])):
            context.encoders.remark(f"A CLIP hardly understands that there shall be no {absent!r}: give it to --avoid.")
        budget = self.settings.budget(reader)
        sights = context.shared.setdefault(f"words seen in {budget.views} views", (Sight(), Sight()))
        words = Text(self.prompt, reader, context.seed, self.settings, sights[0])
        judge = Text(self.prompt, reader, context.seed + _HELD_OUT, self.settings, sights[1])
        return ObjectiveTerm(words, judge.validation, recognizes=True, lasts=budget.lasts, looks=0.34 * budget.views)

    @classmethod
    def interpret(cls, goal: Goal, context: ObjectiveContext) -> Goal:
        """Returns the goal with an initial picture, if its words come without one."""
        from frida_painter_words.beginnings import with_beginning

        said = [term for term in goal.terms if isinstance(term, cls)]
        if not context.encoders.reads_by_clip and any(len(term.prompt) > LONGEST for term in said):
            context.encoders.remark(f"Your words are long; only the first {LONGEST} characters are read.")
        main = max(said, key=lambda term: term.weight, default=None)
        prompt, settings = (None, USUAL) if main is None else (main.prompt, main.settings)
        is_alone = len(said) == len(goal.terms) and not goal.initial
        return with_beginning(goal, context, prompt, settings, is_alone=is_alone)
