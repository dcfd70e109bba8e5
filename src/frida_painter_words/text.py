"""The goal kind `text`: words that say what to paint, and the picture that a painting of them begins with.

That is a scene, coarse colours or nothing. Without a CLIP, which reads words itself, the scene replaces the words: the
plan is grown towards it alone.
"""

from __future__ import annotations

import re
import unicodedata
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from frida_painter.errors import ConfigError
from frida_painter.frames import PixelGrid
from frida_painter.objectives.encoders.loading import EncoderRegistry
from frida_painter.objectives.image import ImageTerm, spread
from frida_painter.objectives.objective import Goal, ObjectiveContext, ObjectiveTerm, Term, require_weight
from frida_painter.objectives.sketch import color_drawing, filled_areas
from frida_painter.objectives.style_flow import change_by_place, styles_of
from frida_painter.objectives.style_marks import in_style
from frida_painter.objectives.text_loss import Sight, Text, color_in, holding_weight, wish
from frida_painter.objectives.word_settings import USUAL, WordSettings, refuse_absent
from frida_painter.system import images
from frida_painter_words.composition import lay_in
from frida_painter_words.reading import LONGEST, contents, split_absent
from frida_painter_words.scene import find_cutout, scene_of

_HELD_OUT = 7919  # added to the seed of views by which a CLIP judges what it has optimised
_APART = 104_729  # added to the seed, so that the views of the choice are not those of the optimiser
_AMONG = 3.0  # weight of the composition against the words that a CLIP reads, beside a style or a sketch
_STAGED = 20.0  # the same for a style picture, or a photograph, that is begun with
_MATTERS = 8.0  # weight of a thing, relative to its surroundings
_OWN = 0.5  # share of its own colours that a thing in a photograph keeps


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
        """Returns the goal with an initial picture, if its words come without one.

        With a CLIP but no network that composes scenes, words alone begin with coarse colours; other goals stay
        unchanged. Raises ConfigError if the settings need a network that is not here; WeightsError if none reads the
        words.
        """
        encoders, by_clip = context.encoders, context.encoders.reads_by_clip
        said = [term for term in goal.terms if isinstance(term, cls)]
        if not by_clip and any(len(term.prompt) > LONGEST for term in said):
            encoders.remark(f"Your words are long; only the first {LONGEST} characters are read.")
        main = max(said, key=lambda term: term.weight, default=None)
        how = USUAL.beginning if main is None else main.settings.beginning
        if how == "scene" and by_clip and not encoders.composes:
            raise ConfigError(
                "--beginning scene puts pictures of things together, and the network for it is not here; fetch it with "
                "`frida-painter models fetch words`, or give --beginning colors."
            )
        if not by_clip and how in ("colors", "nothing"):
            raise ConfigError(
                f"--beginning {how} paints words by a CLIP alone, and none is here; fetch one with `frida-painter "
                "models fetch clip-vit-b-32`, or leave it out."
            )
        is_alone = len(said) == len(goal.terms) and not goal.initial
        if how == "nothing" or (by_clip and not encoders.composes and not is_alone):
            return goal
        if main is None or not is_alone or not by_clip:
            return initial_composition(goal, context.grid, encoders)
        return _begin_for_clip(goal, context, main)


def _begin_for_clip(goal: Goal, context: ObjectiveContext, main: TextTerm) -> Goal:
    """Returns the goal with the first picture that a CLIP finds nearest to the words: a scene or coarse colours."""
    encoders, settings, how = context.encoders, main.settings, main.settings.beginning
    reader, size = encoders.reader(), (context.grid.rows, context.grid.columns)
    judge, remarks, begun = Text(main.prompt, reader, context.seed + _APART, settings), [*encoders.remarks], None
    if how != "colors" and encoders.composes:
        (begun,) = initial_composition(goal, context.grid, encoders).initial
    if how != "scene":
        wanted, budget = wish(main.prompt, reader, settings), settings.budget(reader)
        colors = color_in(wanted, reader, size, context.seed, budget, encoders.tell, encoders.heed)
        with torch.no_grad():
            scene = None if begun is None else begun.picture
            if scene is None or not judge.validation(scene) < judge.validation(colors):
                told = "coloured for the words" if scene is None else "in which they are seen better than in a scene"
                encoders.remarks[:] = remarks
                encoders.remark(f"Begun with a coarse picture, {told}.")
                begun = ImageTerm(colors)
    assert begun is not None and begun.picture is not None
    weight = max(term.weight for term in goal.terms) * holding_weight(judge, images.fit(begun.picture, *size))
    return Goal((*goal.terms, ImageTerm(begun.picture, weight, begun.importance)), (begun,))  # a CLIP changes it little


def initial_composition(goal: Goal, grid: PixelGrid, encoders: EncoderRegistry) -> Goal:
    """Returns the goal with an initial picture, if it has words and no other picture to begin with.

    The picture is also a term, beside the words that a CLIP reads and in place of others. It has the colours and the
    marks of the styles, in proportion if these are lighter than the words. A sketch is filled with the picture's
    colours, or with those of the heaviest style; a style picture or a photograph gets the thing of the words laid in.
    """
    every = sorted((term for term in goal.terms if term.words is not None), key=lambda term: -term.weight)
    words = " and ".join(dict.fromkeys(term.words for term in every if term.words))
    weight = every[0].weight if every else 0.0
    said = goal.terms if encoders.reads_by_clip else tuple(term for term in goal.terms if term.words is None)
    pictured = next((term for term in goal.initial or goal.terms if term.picture is not None), None)
    base = pictured or next((term for term in goal.initial if term.colors is not None), None)
    if base is not None:
        by_clip = pictured is not None and encoders.reads_by_clip
        return _lay_in(goal, base, said, words, weight, encoders) if words and not by_clip else goal
    if goal.initial:
        first = [term.words for term in goal.initial if term.words is not None][:1]
        return replace(goal, initial=(*(_term(*scene_of(one, grid, encoders)) for one in first), *goal.initial))
    if not words:
        return goal
    styles = styles_of(goal)
    drawing = next((term.drawing for term in goal.terms if term.drawing is not None), None)
    if drawing is None:
        picture, where = scene_of(words, grid, encoders)
        kept = _AMONG if any(term.words is None for term in goal.terms) else 1.0
        if styles:
            shown = change_by_place(picture, styles, lambda style: in_style(picture, where, style))
            picture = torch.lerp(picture, shown, min(1.0, sum(one.weight for one in styles) / weight))
        begun = _term(picture, where, weight * kept)
    else:
        style = max(styles, key=lambda term: term.weight).colors if styles else None
        like = scene_of(words, grid, encoders, "coloured like").picture if style is None else style
        filled = color_drawing(images.fit(drawing, grid.rows, grid.columns), like)
        begun = _term(filled, filled_areas(filled), weight * _AMONG)
    return Goal((*said, begun), (replace(begun, weight=1.0),))


def _term(picture: Tensor, where: Tensor, weight: float = 1.0, importance: Tensor | None = None) -> ImageTerm:
    """Returns a picture [3, H, W] as a term: what is at `where` [H, W] has more weight than its ground.

    importance [h, w]: of each place, besides that
    """
    matters = 1 + (_MATTERS - 1) * where
    matters = matters if importance is None else matters * spread(importance, *where.shape)
    return ImageTerm(picture, weight, matters / matters.mean())


@torch.no_grad()
def _lay_in(
    goal: Goal, base: Term, said: tuple[Term, ...], words: str, weight: float, encoders: EncoderRegistry
) -> Goal:
    """Returns the goal with the thing of the words in the photograph or style picture of `base`.

    said: terms that stay; the words are none of them if nothing can read them
    """
    picture, into = (base.colors, "style picture") if base.picture is None else (base.picture, "photograph")
    assert picture is not None
    is_drawn = base.picture is not None and any(term.drawing is not None for term in goal.terms)
    if is_drawn:
        encoders.remark(f"{words[:60]!r} adds nothing to the drawing on the photograph; that needs a CLIP.")
    thing = None if is_drawn else find_cutout(words, encoders, f"laid into the {into}")
    if thing is None:
        return Goal(said or (ImageTerm(picture),), goal.initial)
    shown, where = lay_in(thing.picture, picture, float(bool(thing.phrase.color)) if base.picture is None else _OWN)
    begun = _term(shown, where, _STAGED * weight, base.importance)
    if goal.initial:
        return Goal((*said, begun), (replace(begun, weight=1.0),))
    matters = begun.importance
    assert matters is not None
    laid = (term.with_picture(shown).weigh(matters) if term.picture is picture else term for term in said)
    return Goal(tuple(laid))
