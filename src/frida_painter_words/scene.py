"""From a prompt to a scene: what its words name is found in the libraries and composed, and the account is given."""

import re
from typing import NamedTuple

import torch

from frida_painter.frames import PixelGrid
from frida_painter.objectives.encoders.loading import EncoderRegistry
from frida_painter.system import images
from frida_painter_words.composition import ComposedScene, compose_scene, paint_of, recolor, simplify
from frida_painter_words.reading import COLORS, FUNCTION_WORDS, NUMBERS, Phrase, Reading, contents, read, singular, stem
from frida_painter_words.retrieval import FoundPicture, PictureIndex, picture_index

_MAX_COPIES, _SEVERAL = 5, 3  # pictures in a scene, and copies for a plural without a number
_COVERS = 0.4  # share of the width from which subjects hide what stands in their place
_BESIDE = re.compile(r" with .*?(?= (?:in|on|at|by|under|from) |;|$)")  # the bench of a park
_ALOFT = ("over", "above", "across")  # prepositions of subjects that stand on nothing


class Subject(NamedTuple):
    """Phrase of a prompt, the picture that shows it, and the number of its copies."""

    phrase: Phrase
    found: FoundPicture
    copies: int

    @property
    def says(self) -> frozenset[str]:
        """Stems of the words that the copies show."""
        said = self.phrase.words if self.phrase.count == self.copies else ()
        numbers = [word for word in said if word in NUMBERS or word.isdecimal()]
        return self.found.caption.says | contents([*numbers, *self.phrase.color.split()])

    @property
    def picture(self) -> torch.Tensor:
        """Picture [4, h, w] in the colour of the phrase, unless its caption says that colour."""
        is_said = {*self.phrase.color.split()} <= {*self.found.caption.text.split()}
        return self.found.picture if is_said else recolor(self.found.picture, paint_of(self.phrase.color))


def scene_of(prompt: str, grid: PixelGrid, encoders: EncoderRegistry, use: str = "begun with") -> ComposedScene:
    """Returns the scene of a prompt. Remarks in `encoders` tell its pictures, its account, and what is missing.

    use: use of the scene by the painting, for the remarks
    """
    index = picture_index(encoders)
    reading, subjects = _read(prompt, encoders)
    whole = next((one for one in subjects if one.found.has_ground), None)
    subjects = subjects if whole is None else [whole._replace(copies=1)]
    mood = None if any(one.phrase.name for one in subjects) else index.find_mood(reading, is_said=True)
    ground = None
    if mood is not None:
        subjects = []
    elif whole is None:
        names = {word for one in subjects for word in one.phrase.name}
        others = [word for one in reading.subjects for word in one.words if word not in names]
        ground = index.find_ground(reading, others)
        mood = None if subjects or ground else index.find_mood(reading)
    filling = mood.picture if mood is not None else None if whole is None else whole.picture
    if filling is None:
        copies = [one.picture for one in subjects for _ in range(one.copies)]
        aloft = reading.ground.partition(" ")[0] in _ALOFT
        scene = compose_scene(copies, None if ground is None else ground.picture[:3], grid, aloft=aloft)
    else:
        picture = simplify(images.fit(filling[:3], grid.rows, grid.columns))
        scene = ComposedScene(picture, torch.ones(grid.rows, grid.columns))
    if ground is not None and float((scene.where > 0).any(0).float().mean()) > _COVERS:
        seen = contents(_BESIDE.sub("", "; ".join(ground.caption.titles)))
        ground = ground._replace(caption=ground.caption._replace(says=seen))
    _tell(reading, subjects, ground, mood, encoders, use)
    return scene


def find_cutout(prompt: str, encoders: EncoderRegistry, use: str) -> Subject | None:
    """Returns the first subject of a prompt that has a picture without a ground. Remarks tell it, and what is missing.

    use: what becomes of it, for the remarks
    """
    reading, subjects = _read(prompt, encoders)
    subjects = [one._replace(copies=1) for one in subjects if not one.found.has_ground][:1]
    _tell(reading, subjects, None, None, encoders, use)
    return subjects[0] if subjects else None


def _read(prompt: str, encoders: EncoderRegistry) -> tuple[Reading, list[Subject]]:
    """Returns a prompt as it is read, and its subjects that are shown by pictures of things, with all their copies."""
    index = picture_index(encoders)
    reading, subjects, free = read(prompt, index.knows), list[Subject](), _MAX_COPIES
    for phrase in reading.subjects:
        found = index.find_subject(phrase, reading)
        if found is not None and free:
            subjects.append(Subject(phrase, found, min(free, _copies(phrase, found))))
            free -= subjects[-1].copies
    return reading, subjects


def _copies(phrase: Phrase, found: FoundPicture) -> int:
    """Returns the number of copies of a picture; 1 if its caption says several."""
    if phrase.part.name and phrase.noun not in found.caption.says:  # the oranges of a bowl of oranges
        phrase = phrase.part
    is_several = any(noun != singular(noun) and noun in found.caption.text.split() for noun in phrase.name[-1:])
    return 1 if is_several else max(1, _SEVERAL if phrase.count is None else phrase.count)


def _tell(
    reading: Reading, subjects: list[Subject], ground: FoundPicture | None, mood: FoundPicture | None,
    encoders: EncoderRegistry, use: str,
) -> None:  # fmt: skip
    """Makes remarks about the pictures and their authors, the account, and the missing things with advice."""
    index, grounds = picture_index(encoders), [one.caption for one in (ground, mood) if one is not None]
    parts = [f"{one.found.caption.text!r} ({one.found.caption.library.name})" for one in subjects]
    parts += [f"the mood of {mood.caption.text!r}"] if mood is not None else []
    parts += [f"on {ground.caption.text!r}"] if ground is not None else []
    credits = dict.fromkeys(filter(None, (one.found.caption.library.credit for one in subjects)))
    by = f"; pictures by {'; '.join(credits)}" if credits else ""
    if parts:
        encoders.remark(f"{use.capitalize()}: {', '.join(parts)}{by}.")
    says = frozenset().union(*(one.says for one in subjects), *(one.says for one in grounds))
    similar = {stem(word): one.found.caption.text for one in subjects if one.found.similar for word in one.phrase.name}
    if mood is not None:
        near = [stem(word) for one in reading.subjects if index.is_like(mood.caption, one) for word in one.name]
        similar = {root: mood.caption.text for root in near if root not in says}
    titles = [title for one in (*(one.found.caption for one in subjects), *grounds) for title in one.titles]
    encoders.remark(_account(reading, says, similar, "; ".join(titles), index))
    unseen = [one for one in reading.subjects if one.name and not {one.noun, one.part.noun} & {*says, *similar}]
    if missing := [" ".join(one.proper).title() or " ".join(one.name) for one in unseen]:
        encoders.remark(
            f"No picture of {' and '.join(missing)[:60]!r} was taken; give one with --pictures or "
            "--image, or fetch a generator of pictures: frida-painter models fetch imagine."
        )
    if reading.style:
        encoders.remark(f"{reading.style[:60]!r} is not painted from words; give a picture of that style with --style.")


def _account(reading: Reading, says: frozenset[str], like: dict[str, str], titles: str, index: PictureIndex) -> str:
    """Returns the account in a sentence. says, like: stems that are shown, and captions that others are shown by."""
    wanted, words = contents(reading.text), [word.strip(",.;:!?()\"'") for word in reading.text.split()]
    runs, between = list[tuple[str, str]](), ""
    for raw, before, word, after in zip(reading.text.split(), ["", *words], words, [*words[1:], ""], strict=False):
        root, noun = stem(word), stem(after)
        if word.lower() in FUNCTION_WORDS or root not in wanted:
            between += f"{word} "
            continue
        is_verb = word.endswith("ing") and index.knows(before)
        is_free = raw != word or is_verb or (index.knows(word) and word not in COLORS and not index.knows(after))
        is_elsewhere = not is_free and noun in wanted - says - {*like}  # the lemon of a missing lemon cake
        how = "shown" if root in says and not is_elsewhere else "not shown"
        how = f" (by {like[root]!r})" if root in like else how
        said = f"{runs[-1][0]} {between}{word}" if runs and runs[-1][1] == how else ""
        is_one = said and (not between or said.lower() in titles.lower())
        runs[len(runs) - bool(is_one) :] = [(said if is_one else word, how)]
        between = "" if raw == word else " "
    groups: dict[str, list[str]] = {"shown": [], "shown by something similar": [], "not shown": []}
    for said, how in runs:
        groups.get(how, groups["shown by something similar"]).append(f"'{said}'{'' if how in groups else how}")
    groups["left out as you asked"] = [repr(" ".join(reading.absent))] if reading.absent else []
    told = [f"{name}: {', '.join(said)}" for name, said in groups.items() if said]
    return f"Your words: {'; '.join(told)}."
