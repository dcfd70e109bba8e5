"""From a prompt to a scene: what its words name is found in the libraries and composed, and the account is given."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import torch

from frida_painter import images
from frida_painter.frames import PixelGrid
from frida_painter.objectives.encoders.loading import EncoderRegistry
from frida_painter.objectives.objective import Goal
from frida_painter.palette import from_lab, to_lab
from frida_painter.words.compositing import recolor
from frida_painter.words.composition import ComposedScene, compose_scene, simplify
from frida_painter.words.reading import (
    COLORS,
    FUNCTION_WORDS,
    MAX_COPIES,
    NUMBERS,
    SHADES,
    Phrase,
    Reading,
    contents,
    read,
    singular,
    stem,
)
from frida_painter.words.retrieval import SAME_MOOD, FoundPicture, PictureIndex, has_ground, picture_index

Found = list[tuple[Phrase, FoundPicture]]
"""Subjects of a prompt with their pictures."""
_SEVERAL = 3  # copies for a plural without a number
_ALOFT = ("over", "above", "across")  # prepositions of subjects that stand on nothing


def scene_of(
    prompt: str, grid: PixelGrid, encoders: EncoderRegistry, seed: int, use: str = "begun with"
) -> ComposedScene:
    """Returns the scene of a prompt. Remarks in `encoders` tell its pictures, its account, and what is missing.

    use: use of the scene by the painting, for the remarks
    """
    index = picture_index(encoders)
    reading = read(prompt, index.knows)
    found = find_subjects(reading, index)
    ground, filling = None, next((one for _, one in found if has_ground(one.picture)), None)
    if filling is not None:
        found = [(phrase, one) for phrase, one in found if one is filling]
    elif found or (filling := index.find_mood(reading, SAME_MOOD)) is None:
        # Words after a subject's noun may name a ground too: a train crossing a bridge.
        names = {word for one, _ in found for word in one.name}
        words = [word for one in reading.subjects for word in one.words if word not in names]
        ground = index.find_ground(" ".join([*words, reading.ground]), reading)
        filling = index.find_mood(reading) if not found and ground is None else None
    _tell(reading, found, ground, None if found else filling, encoders, use)
    for fault in dict.fromkeys(index.faults):
        encoders.remark(f"Of your own pictures one cannot be used: {fault}")
    if filling is not None:
        picture = _colored(found[0][0], filling) if found else filling.picture
        picture = simplify(images.fit(picture[:3], grid.rows, grid.columns))
        return ComposedScene(picture, torch.ones(grid.rows, grid.columns))
    copies = [_colored(phrase, one) for phrase, one in found for _ in range(_copies(phrase, one))]
    aloft = reading.ground.partition(" ")[0] in _ALOFT
    scenery = None if ground is None else ground.picture[:3]
    return compose_scene(copies[:MAX_COPIES], scenery, grid, seed, aloft=aloft)


def find_subjects(reading: Reading, index: PictureIndex) -> Found:
    """Returns the subjects of a prompt that are shown by pictures of things, not by grounds or moods."""
    found = [(one, index.find_subject(one, reading)) for one in reading.subjects]
    return [(phrase, picture) for phrase, picture in found if picture is not None]


class Cutout(NamedTuple):
    """Picture of a thing without a ground, colour and opacity [4, h, w].

    has_color: True if the words name its colour
    """

    picture: torch.Tensor
    has_color: bool


def find_cutout(prompt: str, encoders: EncoderRegistry, use: str) -> Cutout | None:
    """Returns the first subject of a prompt that has a picture without a ground. Remarks tell it, and what is missing.

    use: what becomes of it, for the remarks
    """
    index = picture_index(encoders)
    reading = read(prompt, index.knows)
    found = [(phrase, one) for phrase, one in find_subjects(reading, index) if not has_ground(one.picture)][:1]
    _tell(reading, found, None, None, encoders, use)
    return Cutout(_colored(*found[0]), bool(found[0][0].color)) if found else None


def words_of(goal: Goal) -> tuple[str, float]:
    """Returns the words of a goal as one sentence, the heaviest first, and their largest weight; "" and 0 if none."""
    said = [(term.words, term.weight) for term in goal.terms if term.words is not None]
    said.sort(key=lambda pair: -pair[1])
    return " and ".join(dict.fromkeys(some for some, _ in said)), said[0][1] if said else 0.0


def _tell(
    reading: Reading,
    found: Found,
    ground: FoundPicture | None,
    mood: FoundPicture | None,
    encoders: EncoderRegistry,
    use: str,
) -> None:
    """Makes remarks about the pictures and their authors, the account, and the missing things with advice."""
    shown = [_Shown(one.caption, one.says | _done(phrase), phrase.noun if one.similar else "") for phrase, one in found]
    shown += [_Shown(one.caption, one.says) for one in (ground, mood) if one is not None]
    parts = [f"{one.caption!r} ({one.library.name})" for _, one in found]
    parts += [f"the mood of {mood.caption!r}"] if mood is not None else []
    parts += [f"on {ground.caption!r}"] if ground is not None else []
    credits = dict.fromkeys(one.library.credit for _, one in found if one.library.credit)
    by = f"; pictures by {'; '.join(credits)}" if credits else ""
    if parts:
        encoders.remark(f"{use.capitalize()}: {', '.join(parts)}{by}.")
    encoders.remark(account_for(reading, shown))
    says = frozenset().union(*(part.says | {part.similar} for part in shown))
    unseen = [one for one in reading.subjects if one.name and not ({one.noun, one.part.noun} - {""}) & says]
    missing = [" ".join(one.proper).title() or " ".join(one.name) for one in unseen]
    if missing:
        encoders.remark(
            f"No picture here shows {' and '.join(missing)[:60]!r}, so it is not painted; give one with --pictures or "
            "--image, or fetch a model: frida-painter models fetch clip-vit-b-32, or --imagine."
        )
    if reading.style:
        encoders.remark(f"{reading.style[:60]!r} is not painted from words; give a picture of that style with --style.")


@dataclass(frozen=True)
class _Shown:
    """Part of a scene.

    caption: of its picture
    says: stems of the words that it shows
    similar: stem of the prompt's word that it shows by another word of the same meaning, or ""
    """

    caption: str
    says: frozenset[str]
    similar: str = ""


def account_for(reading: Reading, shown: Sequence[_Shown]) -> str:
    """Returns the account of a prompt in one sentence. A word is shown only if a picture that was chosen says it."""
    groups: dict[str, list[str]] = {"shown": [], "shown by something similar": [], "not shown": []}
    wanted, says = contents(reading.text), frozenset().union(*(part.says for part in shown))
    before = ""
    for word in reading.text.split():
        plain = word.strip(",.;:!?()\"'")
        if plain.lower() in FUNCTION_WORDS or stem(plain) not in wanted:
            before = ""
            continue
        other = next((part.caption for part in shown if part.similar == stem(plain)), "")
        name = "shown" if stem(plain) in says else "shown by something similar" if other else "not shown"
        said = f"{plain}' (by '{other}'" if name == "shown by something similar" else plain
        if before == name and groups[name]:
            groups[name][-1] += f" {said}"
        else:
            groups[name].append(said)
        before = name
    groups["left out as you asked"] = [" ".join(reading.absent)] if reading.absent else []
    told = [f"{name}: {', '.join(_quote(words) for words in said)}" for name, said in groups.items() if said]
    return f"Your words: {'; '.join(told)}."


def _quote(words: str) -> str:
    return f"'{words})" if " (by '" in words else f"'{words}'"


def _copies(phrase: Phrase, found: FoundPicture) -> int:
    """Returns the number of copies of a picture; 1 if its caption says several."""
    if phrase.part.name and phrase.noun not in found.says:  # the oranges of a bowl of oranges
        phrase = phrase.part
    noun = phrase.name[-1] if phrase.name else ""
    if noun in found.caption.split() and noun != singular(noun):
        return 1
    return max(1, _SEVERAL if phrase.count is None else phrase.count)


def _done(phrase: Phrase) -> frozenset[str]:
    """Returns the stems of a phrase's colour and number that its copies have."""
    has_number = 1 < (phrase.count or 0) <= MAX_COPIES
    numbers = {word for word in phrase.words if word in NUMBERS or word.isdecimal()} if has_number else set()
    return contents([*numbers, *phrase.color.split()])


def _colored(phrase: Phrase, found: FoundPicture) -> torch.Tensor:
    """Returns a picture [4, h, w] in the colour of its phrase, unless its caption says that colour."""
    paint = None if set(phrase.color.split()) <= set(found.caption.split()) else paint_of(phrase.color)
    return found.picture if paint is None else recolor(found.picture, paint)


def paint_of(color: str) -> torch.Tensor | None:
    """Returns the sRGB [3] in [0, 1] of a colour such as "dark blue"; None for "". Of several, the first counts."""
    words = color.split()
    first = next((word for word in words if word in COLORS), None)
    if first is None:
        return None
    lab = to_lab(torch.tensor(COLORS[first]) / 255)
    lab[0] = (lab[0] + sum(SHADES.get(word, 0) for word in words[: words.index(first)])).clamp(5, 97)
    return from_lab(lab).clamp(0, 1)
