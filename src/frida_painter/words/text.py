"""The goal kind `text`: words that say what to paint."""

from __future__ import annotations

import re
import unicodedata
from dataclasses import dataclass

from frida_painter.errors import ConfigError
from frida_painter.objectives.objective import (
    Gives,
    Goal,
    GoalKind,
    ObjectiveContext,
    ObjectiveTerm,
    Term,
    require_weight,
)

_LASTS = 4  # iterations that one gradient serves in a style, which has its own and keeps the scene


@dataclass(frozen=True)
class TextTerm(Term):
    """Term for words: `prompt` is one line with at least one Latin letter. Raises ConfigError otherwise."""

    prompt: str
    weight: float = 1.0
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

    @property
    def words(self) -> str:
        """The prompt."""
        return self.prompt

    def prepare(self, context: ObjectiveContext) -> ObjectiveTerm:
        """Returns the text objective of the prompt, which also keeps to the initial picture.

        It is validated by a reader that the optimiser never uses, if there is one.
        """
        from frida_painter.words.meaning import Text

        readers = context.encoders.readers()
        if not all(reader.reads_all(self.prompt) for reader in readers):
            context.encoders.remark(
                f"The words {self.prompt[:40]!r}... are too many to be read; the last were cut off."
            )
        words = Text(self.prompt, readers, context.seed, context.begun)
        aside = context.encoders.reader_aside()
        steady = words if aside is None else Text(self.prompt, [aside], context.seed, context.begun)
        return ObjectiveTerm(words, steady.validation, recognizes=True, lasts=_LASTS if context.in_style else 1)

    @classmethod
    def interpret(cls, goal: Goal, context: ObjectiveContext) -> Goal:
        """Returns the goal with an initial picture, if its words come without one."""
        from frida_painter.words.scene import initial_composition

        return initial_composition(goal, context.grid, context.encoders, context.seed)


KIND = GoalKind(
    name="text",
    gives=Gives.WORDS,
    help='A text prompt: what to paint, like "a sailing ship".',
    label="Words",
    open=TextTerm,
    initial_help="A text prompt to start from. The painting keeps its composition.",
    networks=(("minilm",), ("efficientnet-lite0",)),
)
