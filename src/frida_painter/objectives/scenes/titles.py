"""What the title of a picture says: what it names, and how well that is a thing of a prompt."""

import re
from dataclasses import replace

from frida_painter.objectives.encoders.conse import synonyms
from frida_painter.objectives.scenes.reading import Thing, paint_of

_SAID = 0.3  # for the word for what it does, and for a name that begins with the colour: a red panda
_MODIFIES = 0.6  # against a title in which the word only says more of another
_UNSAID = 0.2  # against a title that says more than the words, as an alien tree, or a nut and bolt
_FURTHER = re.compile(r"\b(?:of|with|in|on|at|for|and)\b")  # what follows is not what is named
_WORD, _ALL_WORDS, _OTHERS = 0.15, 0.4, 0.05  # for the very word, for all of several words, and for each too many
SEVERAL = (None, 2)  # things of a plural that one picture may show: flowers, or a pair of scissors


def cleaned(caption: str) -> str:
    """A caption without article, numbers, underscores and what is in brackets, but for a colour; in small letters."""
    colors = [word for word in re.findall(r"\((.*?)\)", caption.lower()) if paint_of(word) is not None]
    plain = re.sub(r"\(.*?\)|[^a-zA-Z' -]+", " ", caption)
    plain = re.sub("^(an?|the|another|some|my|our) ", "", " ".join(plain.split()).lower())
    return " ".join([*colors[:1], plain]).strip() or caption


def in_small_letters(thing: Thing) -> Thing:
    """The thing as captions call it: the Eiffel Tower is the eiffel tower."""
    return replace(thing, name=thing.name.lower(), noun=thing.noun.lower(), plural=thing.plural.lower())


def named(title: str) -> list[str]:
    """The words of a title that name what it shows; the last one says what it is."""
    return _FURTHER.split(title)[0].split()


def spoken(title: str, thing: Thing) -> float:
    """What it is worth that a title has the very word, is no more than it, and speaks of little else."""
    plain = _plain(title, thing)
    words = plain.split()
    others = max(0, len(words) - len(thing.name.split()) - 1)
    name = thing.name.split()
    unsaid = set(named(plain)[:-1] + plain.partition(" and ")[2].split()) - {*name, thing.noun}
    worth = -_MODIFIES * is_modified(title, thing) - _OTHERS * others - _UNSAID * bool(unsaid)
    worth += _SAID * bool(thing.doing and thing.doing in title.split())
    worth += _SAID * bool(thing.color and title == f"{thing.color} {thing.name}")
    worth += _WORD * (thing.noun in words) + _WORD * (plain == thing.name)
    return worth + _ALL_WORDS * (len(name) > 1 and set(name) <= set(words))


def is_modified(title: str, thing: Thing) -> bool:
    """Whether a title names another thing by the word, as a mountain goat is no mountain, and a fencer is no fence, or
    one that is there: an owl on a branch is no branch.

    Of words that make one name the last says what it is, but a hyphen makes a name of its own: a jack-o'-lantern.
    """
    names = named(_plain(title, thing))
    endings = [word.removeprefix(thing.noun) for word in title.split() if word.startswith(thing.noun)]
    is_derived = any(ending not in ("", "s", "es") for ending in endings)
    is_joined = any(word.endswith(f"-{thing.noun}") for word in names)
    is_around = re.search(rf"\b(?:on|in|with) (?:\w+ )*{re.escape(thing.noun)}\b", _plain(title, thing)) is not None
    return thing.noun not in names[-1:] and (thing.noun in names or is_derived or is_joined or is_around)


def is_called(title: str, thing: Thing) -> bool:
    """Whether a title has the very word, or ends in it as a sailboat does, or a synonym, and means no other kind.

    A washing machine is no sewing machine, where a machine may be one.
    """
    kind, wanted = set(named(title)[:-1]), set(thing.name.split()[:-1])
    if kind and wanted and not kind & wanted:
        return False
    words = _plain(title, thing).split()
    names = (thing.noun, *(other.split()[-1].lower() for other in synonyms(thing.name)))
    return any(word.endswith((name, f"{name}s")) for word in words for name in names)


def _plain(title: str, thing: Thing) -> str:
    """The title without the thing's colour and what it does; in the singular where one picture may show several."""
    told = {*thing.color.split(), thing.doing}
    words = [word for word in title.split() if word not in told]
    if thing.plural and thing.count in SEVERAL:
        words = [thing.noun if word == thing.plural else word for word in words]
    return " ".join(words) or title
