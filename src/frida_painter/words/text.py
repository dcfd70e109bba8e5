"""The goal kind `text`: words that say what to paint."""

from __future__ import annotations

import re
import unicodedata
from dataclasses import dataclass, replace

from frida_painter.errors import ConfigError
from frida_painter.objectives.objective import (
    GRADIENT_LASTS,
    Gives,
    Goal,
    GoalKind,
    ObjectiveContext,
    ObjectiveTerm,
    Term,
    require_weight,
)
from frida_painter.objectives.word_settings import USUAL, WordSettings, refuse_absent

# "no dogs, no cats", "without any people or cars", "neither dogs nor cats"; but not "no dog, a cat", "no more war", and
# no longer name: "no people in the street", "no country for old men". The grammar, if there is one, reads all others.
_NAME = r"(?!(?:an?|the|one|two|more|longer)\b)[a-z-]+(?: [a-z-]+)?"
_ABSENT = rf"(?:no|not|without|neither|nor) (?:(?:any|an?|the) )?{_NAME}"
_ALL_ABSENT = re.compile(rf"{_ABSENT}(?:[,;.]?(?: and| or)? {_ABSENT}|(?: and| or) {_NAME})*")
_NEGATION = re.compile(r"\b(?:no|not|without|neither|never)\b", re.IGNORECASE)
_LASTS = 10  # iterations for which one gradient of a CLIP serves
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
            raise ConfigError(
                f"{self.prompt[:40]!r} has no word in Latin letters; the networks that read it know English, "
                "so say it in English."
            )
        said = " ".join(self.prompt.lower().split()).rstrip(".!")
        if _ALL_ABSENT.fullmatch(said):
            raise refuse_absent(self.prompt)

    @property
    def words(self) -> str:
        """The prompt."""
        return self.prompt

    def say(self, settings: WordSettings) -> TextTerm:
        """Returns the term with these settings of its words."""
        return replace(self, settings=settings)

    def prepare(self, context: ObjectiveContext) -> ObjectiveTerm:
        """Returns the text objective of the prompt, which also keeps to the initial picture.

        It is validated by a reader that the optimiser never uses, if there is one. A CLIP validates itself what it
        has optimised, in views that the optimiser never sees: smaller networks may not overrule it.
        """
        from frida_painter.objectives.text_loss import Sight, Text

        readers = context.encoders.readers()
        if not all(reader.reads_all(said) for reader in readers for said in self.settings.say(self.prompt)):
            context.encoders.remark(
                f"The words {self.prompt[:40]!r}... are too many to be read; the last were cut off."
            )
        sights = context.shared.setdefault(f"words seen in {self.settings.cutouts} views", (Sight(), Sight()))
        words = Text(self.prompt, readers, context.seed, context.begun, self.settings, sights[0])
        if context.encoders.reads_by_clip:
            if not self.settings.avoid and (negation := _NEGATION.search(self.prompt)):
                context.encoders.remark(
                    f"A network like this hardly understands {negation[0]!r}: name what must not be seen with --avoid."
                )
            judge = Text(self.prompt, readers, context.seed + _HELD_OUT, settings=self.settings, sight=sights[1])
            return ObjectiveTerm(words, judge.validation, recognizes=True, lasts=_LASTS)
        aside = context.encoders.reader_aside()
        steady = words if aside is None else Text(self.prompt, [aside], context.seed, context.begun, self.settings)
        lasts = GRADIENT_LASTS if context.in_style else 1
        return ObjectiveTerm(words, steady.validation, recognizes=True, lasts=lasts, smooth=context.in_style)

    @classmethod
    def interpret(cls, goal: Goal, context: ObjectiveContext) -> Goal:
        """Returns the goal with an initial picture, if its words come without one."""
        from frida_painter.words.beginnings import with_beginning

        said = [term for term in goal.terms if isinstance(term, cls)]
        main = max(said, key=lambda term: term.weight, default=None)
        prompt, settings = (None, USUAL) if main is None else (main.prompt, main.settings)
        is_alone = len(said) == len(goal.terms) and not goal.initial
        return with_beginning(goal, context, prompt, settings, is_alone=is_alone)


KIND = GoalKind(
    name="text",
    gives=Gives.WORDS,
    help='A text prompt: what to paint, like "a sailing ship".',
    label="Words",
    open=TextTerm,
    initial_help="A text prompt to start from. The painting keeps its composition.",
    networks=(("clip-vit-b-32", "minilm"), ("clip-vit-b-32", "efficientnet-lite0")),
)
