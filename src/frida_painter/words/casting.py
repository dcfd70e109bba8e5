"""Casting: the choice of a picture for each thing of a prompt. People without a picture of their action are drawn."""

import re
import zlib
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

from torch import Tensor

from frida_painter.drawing import figures
from frida_painter.drawing.appearance import looks_of
from frida_painter.drawing.arrangement import RIDES, copies, kind_of
from frida_painter.drawing.compositing import stack
from frida_painter.drawing.figures import Clothes, Figure, Pose, Tool
from frida_painter.objectives.encoders.loading import EncoderRegistry
from frida_painter.objectives.encoders.sentence import SentenceEncoder
from frida_painter.words.nouns import kinds_of, senses_of
from frida_painter.words.reading import COLORS, GROUPS, PEOPLE, Reading, Thing, paint_of, word_meanings
from frida_painter.words.retrieval import FoundPicture, PictureIndex, is_upright
from frida_painter.words.world import is_part_of_body, is_person, known_like

_EXACT = 0.98  # similarity above which one picture shows a measure with its content
CALLED = 0.9
"""Similarity above which a picture is of the thing itself."""

_DRESSED, _KNOWN = 0.6, 0.8  # similarity above which clothes are like those of a name, and above which they are those
_DOES, _WITH = 0.5, 0.8  # similarity above which a pose is that of a verb, and that of a verb with its object
_USES = 0.72  # similarity above which a verb alone has a tool
_IS = 0.66  # similarity above which a pose is that of a name: a violinist plays the violin, and a rower is rowing
_DOER = re.compile("(er|or|ist)$")  # ending of a name for who does something
_ANYBODY, _FAMILY = 4, 6  # numbers of the clothes, the first ones, of people without a trade, and of families
_LONG = ("skirt", "robe")  # cuts of clothes of one colour
_UPRIGHT = 45  # degrees by which somebody leans who can sit too
_OLD, _AGED = ("old", "elderly", "grandmother", "grandfather"), 0.75  # who has white hair, and the least similarity
_CHILD, _GROWN = (4.0, 0.6), (7.0, 1.6)  # heights of a body in heads and in metres

_LEGS = 6  # place of the legs among the angles of a pose
_HANDLES = ("on", "in", "with", "hold", "doing")  # kinds of relations of a body to a thing


class Act(NamedTuple):
    """Action of a person: its pose, the words of the tables that mean it, or "", and its tool."""

    pose: Pose
    meant: str
    tool: Tool | None = None

    def shows(self, thing: Thing, sentences: SentenceEncoder) -> bool:
        """Returns True if the tool is that thing."""
        names = (thing.noun, thing.plural or thing.noun, thing.name)
        shown = self.tool and figures.nearest(names, [self.tool._replace(words=self.tool.things)], sentences)
        return shown is not None and shown[2] >= CALLED


Cast = list[FoundPicture | None]
_Worn = tuple[Thing, Clothes]


def cast(
    reading: Reading,
    settled: set[int],
    prompt: str,
    index: PictureIndex | None,
    encoders: EncoderRegistry,
    *,
    in_place: bool,
) -> Cast:
    """Returns a picture for each thing; None for a thing without one, or a thing of the setting.

    settled: numbers of the things that belong to the setting
    in_place: True if the scene shows a place too, so that pictures without a ground are needed

    A measure and its content are one thing, a cup of coffee, and clothes are shown by their colour.
    """
    things: Cast = [None] * len(reading.things)
    if index is None:
        return things
    sentences, rows = word_meanings(encoders), figures.wardrobe("garments.txt")
    like = [figures.nearest((thing.plural or thing.noun, thing.name), rows, sentences) for thing in reading.things]
    garments = {number: row for number, (row, _, similarity) in enumerate(like) if similarity >= _KNOWN}
    wanted = {
        number: thing
        for number, thing in enumerate(reading.things)
        if (number not in settled or number in garments)
        and not (thing.noun in COLORS and thing.uncounted)
        and (" " not in thing.noun or index.nearest(thing) >= CALLED or is_person(thing.name, sentences))
    }
    dressed: defaultdict[int, list[_Worn]] = defaultdict(list)
    for one in reading.relations:
        if not {one.subject, one.object} <= {*wanted}:
            continue
        first, second = wanted[one.subject], wanted[one.object]
        at, name = (*first.at, *second.at), f"{first.name} {one.word} {second.plural or second.name}"
        is_one = one.word in ("of", "with", "in") and index.nearest(Thing(name, name)) >= _EXACT
        lives = any(sense.is_kind_of(senses_of("animal")[0]) for sense in senses_of(second.noun)[:1])
        if kind_of(one.word) == "made":
            pass  # its look tells of the material
        elif is_one or (one.word == "of" and second.uncounted and not lives):
            noun, color = (first.noun, first.color or second.color) if is_one else (second.noun, second.color)
            first = replace(first, name=name, noun=noun, color=color, at=at)
        elif one.word in ("in", "with") and one.object in garments and is_person(first.name, sentences):
            dressed[one.subject].append((second, garments[one.object]))
        elif one.word in ("in", "with") and known_like(second.name, sentences).where == "worn":
            first = replace(first, color=second.color)
        elif one.word == "with" and _is_look(second.plural or second.noun, sentences):
            pass  # a cup with steam, a cup with spots
        else:
            continue
        wanted |= {one.subject: first}
        del wanted[one.object]
    people = {number for number, thing in wanted.items() if is_person(thing.name, sentences)}
    ridden = {one.object: kind_of(one.word) for one in reading.relations if kind_of(one.word) in RIDES}
    ridden |= {one.subject: "seat" for one in reading.relations if kind_of(one.word) in RIDES}
    alive = [one for one in wanted if one in people or known_like(wanted[one].name, sentences).where == "animal"]
    groups = {number: GROUPS.get(wanted[number].noun) for number in people if wanted[number].count == 1}
    wanted |= {number: replace(wanted[number], count=count) for number, count in groups.items() if count}
    acts = {number: _act_of(number, wanted[number], reading, sentences) for number in people}
    for one in reading.relations:  # who is hugged hugs too
        if {one.subject, one.object} <= people and not wanted[one.object].doing:
            tool = acts[one.subject].tool
            is_idle = one.object not in {each.subject for each in reading.relations}
            still = Act(figures.poses()[0], "") if is_idle else acts[one.object]
            acts[one.object] = acts[one.subject] if tool and tool.meets else still
    acting = any(wanted[number].doing and act.meant for number, act in acts.items()) or any(
        one.subject in people and one.object in wanted and kind_of(one.word) in _HANDLES for one in reading.relations
    )
    tools: dict[int, int] = {}  # things that the tool of somebody shows, such as soup, and the pot that it is in
    for one in 2 * reading.relations:
        user = one.subject if one.subject in people else tools.get(one.subject)
        named = wanted.get(one.object, reading.things[one.object])
        if user is not None and not named.doing and acts[user].shows(named, sentences):
            tools[one.object] = user
    later = [number for number in wanted if alive and number > min(alive)]  # the ears of a dog are no further thing
    bodies = {number for number in later if is_part_of_body(wanted[number].noun, sentences)}
    unseen = {number for number in people if wanted[number].noun in PEOPLE and not acts[number].meant}
    unseen |= {one.object for one in reading.relations if one.subject in unseen} & people  # losing a friend
    for number, thing in sorted(wanted.items(), key=lambda one: one[0] in people):  # things first, which carry people
        if number in {*tools} | bodies | unseen:
            continue
        among = len(wanted) > 1 or in_place or thing.shown > 1
        found = index.find(thing, prompt, cut_out=among, acts=bool(among or thing.doing))
        is_own = found is not None and found.library is not None and found.library.is_own
        found = found if is_own or number not in people & {*ridden, *dressed, *tools.values()} else None
        if number in people and not _shows_person(found, reading, sentences, acting=acting, among=among):
            under = [
                one.object
                for one in reading.relations
                if one.subject == number and one.object in {*wanted} - {*tools} and kind_of(one.word) in ("on", "in")
            ]
            carriers = [known_like(wanted[one].name, sentences).where for one in under]
            carriers += [ridden[number]] if number in ridden else []
            has_seat = any(things[one] is not None for one in under) or ridden.get(number, "lap") != "lap"
            mine = [wanted.get(tool, reading.things[tool]) for tool, user in tools.items() if user == number]
            is_faced = number != min(people) and number not in ridden  # people look at each other
            act, dyes, worn = acts[number], [dye for one in mine if (dye := _dye_of(one))], dressed[number]
            if act.tool is not None and dyes:  # a red kite
                act = act._replace(tool=act.tool._replace(color=dyes[0]))
            found = _draw_person(thing, act, sentences, carriers, worn, has_seat=has_seat, is_faced=is_faced)
            mine += [one for one, _ in worn]
            known = act.tool.things if act.tool else ()
            shown = [f"{one.color} {one.name if one.name in known else one.noun}".strip() for one in mine]
            found = replace(found, caption=" ".join(dict.fromkeys(" ".join((found.caption, *shown)).split())))
        if found is None and number == min(wanted):  # its picture with a ground may be all
            found = index.find(thing, prompt, cut_out=thing.shown > 1, kin=True)
        others = {one.caption for one in things if one is not None}
        if found is not None and (found.exact or found.figure or found.caption not in others):  # a king is no throne
            things[number] = replace(found, thing=thing)
    return things


def _is_look(noun: str, sentences: SentenceEncoder) -> bool:
    """Returns True if a noun is no thing that can be touched, and tells what another one looks like."""
    is_thing = bool(senses_of(noun)) and kinds_of(noun) != {"idea"}
    return not is_thing and bool(looks_of([noun], sentences, is_person=False))


def _shows_person(
    found: FoundPicture | None, reading: Reading, sentences: SentenceEncoder, *, acting: bool, among: bool
) -> bool:
    """Returns True if a picture serves for a person: the user's own, or one of just that person or action.

    acting: True if anybody in the scene does something
    among: True if the person is among others, or in a place
    """
    if found is None or found.library is None or found.library.is_own:
        return found is not None
    actions = [word for word in reading.said if word.kind == "action" and word.at in found.thing.at]
    does = any(word.says(found.caption) for word in actions)
    is_as_old = {*_old(found.thing.name, sentences)} <= {*found.caption.split()}
    is_whole = not among or is_upright(found.picture)
    return found.exact and is_as_old and is_whole and (does or not acting) and found.shown == 1  # people differ


def _draw_person(
    thing: Thing,
    act: Act,
    sentences: SentenceEncoder,
    carriers: list[str],
    worn: list[_Worn],
    *,
    has_seat: bool,
    is_faced: bool,
) -> FoundPicture:
    """Returns a drawn figure of a person who acts.

    carriers: kinds of the things that the person is on or in, such as "seat"; "lap" for somebody with one on the lap
    worn: named clothes
    has_seat: True if one of them is shown, for somebody who sits
    is_faced: True if somebody else acts on the person, who looks back
    """
    clothes, called, alike = figures.nearest([thing.name], figures.wardrobe(), sentences)
    family = figures.wardrobe()[:_FAMILY]
    if alike < _DRESSED:
        clothes, called, _ = figures.nearest([thing.noun], family[:_ANYBODY], sentences)
    rows = family if thing.noun in GROUPS else [row for row in family if row.words[0] in clothes.kinds] or [clothes]
    dressed = [_dress(row, thing, worn) for row in rows]
    old = _old(thing.name, sentences)
    (least, small), (most, tall) = _CHILD, _GROWN
    grown = (known_like(thing.name, sentences).height - small) / (tall - small)
    pose = act.pose
    heads = least + (most - least) * min(1.0, max(0.0, grown))
    sits = {"lap", "seat"} & {*carriers}
    if pose.carried == "ground" and sits and abs(pose.angles[0]) < _UPRIGHT:  # to feed ducks on a bench
        sitting = next(one for one in figures.poses() if "sitting" in one.words)
        pose = pose._replace(angles=(*pose.angles[:_LEGS], *sitting.angles[_LEGS:]), carried="seat")
    drawn = []
    for copy in range(thing.shown):
        kind = zlib.crc32(thing.name.encode()) + copy
        figure = figures.draw_figure(
            pose, dressed[copy % len(dressed)], heads=heads, is_old=bool(old), kind=kind,
            has_seat=has_seat, tool=act.tool,
        )  # fmt: skip
        drawn.append(figure.mirror() if is_faced or copy % 2 else figure)
    figure = drawn[0]
    if len(drawn) > 1:
        pairs = [_join(drawn[at : at + 2]) for at in range(0, len(drawn), 2)]
        together = pairs if figure.meets is not None else [one.picture for one in drawn]
        picture = copies(together, "seat" if sits else "person", 0)
        figure = replace(figure, picture=picture, hand=(0.0, figure.hand[1]), meets=None, holds={})
    is_exact = alike >= _KNOWN
    said = [*old, thing.noun if is_exact else called, thing.doing if act.meant else ""]
    caption = " ".join(dict.fromkeys(word for word in said if word))
    return FoundPicture(thing, figure.picture, caption, None, is_exact, replace(figure, does=act.meant))


def _dress(clothes: Clothes, thing: Thing, worn: list[_Worn]) -> Clothes:
    """Returns the clothes in the colour that is said of somebody, with the named ones over them."""
    if dyed := _dye_of(thing):
        clothes = clothes._replace(top=dyed, bottom=dyed if clothes.cut in _LONG else clothes.bottom)
    for one, garment in worn:
        clothes = clothes.put_on(garment, _dye_of(one) or str(garment.top))
    return clothes


def _dye_of(thing: Thing) -> str:
    """Returns the colour of a thing that its words say, as in `#a0b0c0`; "" for none."""
    paint = paint_of(thing.color)
    return "" if paint is None else "#" + "".join(f"{round(255 * part):02x}" for part in paint.tolist())


def _join(some: Sequence[Figure]) -> Tensor:
    """Returns the picture [4, h, w] of two who meet, and look at each other, or of one who is alone."""
    starts = [-round((0.5 + (one.meets or 0.0)) * one.picture.shape[2]) for one in some]
    high, left = max(one.picture.shape[1] for one in some), min(starts)
    parts = [(one.picture, high - one.picture.shape[1], at - left) for one, at in zip(some, starts, strict=True)]
    return stack(parts, high, max(at + picture.shape[2] for picture, _, at in parts))


def _old(name: str, sentences: SentenceEncoder) -> list[str]:
    """Returns the words of a name that mean that somebody is old."""
    words = name.split()
    ages = (sentences.embed(words) @ sentences.embed(_OLD).T).amax(1)
    return [word for word, age in zip(words, ages.tolist(), strict=True) if age >= _AGED]


def _act_of(number: int, thing: Thing, reading: Reading, sentences: SentenceEncoder) -> Act:
    """Returns the action of a person; that of somebody who stands means nothing."""
    said, climbed = [], []
    for one in reading.relations:
        if one.subject == number:
            is_verb = one.word.startswith(thing.doing) or one.word.endswith("ing")
            verb = one.word if is_verb else f"{thing.doing} {one.word}"
            other = reading.things[one.object]
            called = dict.fromkeys((other.plural or other.noun, other.name))
            said += [f"{verb} {name}" for name in called]
            said += [verb] if " " in verb == one.word and thing.doing else []  # holding a hand
            climbed += [f"on {name}" for name in called if one.word in ("up", "down")]
    named = [thing.name, _DOER.sub("ing", thing.noun)]
    alone = [*said, *([thing.doing] if thing.doing else named)]
    rows: tuple[Pose | Tool, ...] = (*figures.tools(), *figures.poses())
    standing = figures.poses()[0]
    for some, table, least in (
        (climbed or ["on"], figures.tools(), CALLED),
        (said if said and thing.doing else alone, rows, _WITH),  # flying a kite is not flying
        (alone, rows, _WITH),
        (named, rows, _WITH),  # whatever a photographer does, there is a camera
        (alone, rows, _USES),
        (alone, figures.poses(), _USES if thing.noun in PEOPLE else _DOES if thing.doing else _IS),
    ):
        row, meant, similarity = figures.nearest(some, table, sentences)
        stands = row is standing and not (thing.doing and similarity >= _WITH)  # to wait is to stand
        if similarity >= least and not stands:
            if isinstance(row, Tool):
                return Act(row.pose, meant, row)
            tool, _, like = figures.nearest(named, figures.tools(), sentences)
            has = like >= _WITH and (
                row.carried == "ground" or row == tool.pose
            )  # a surfer who waits, a cyclist who rides
            return Act(row, meant, tool if has else None)
    return Act(standing, "")
