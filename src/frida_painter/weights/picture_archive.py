"""Picture libraries in one form: a zip of pictures, with what each shows in `captions.json`."""

import json
import re
import zipfile
from collections.abc import Iterable, Iterator
from pathlib import Path
from xml.etree import ElementTree

from frida_painter.errors import WeightsError
from frida_painter.weights.debian import files_of

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


def repack_openclipart(package: Path, archive: Path) -> None:
    """The drawings of Debian's openclipart-svg that show things, by the titles and keywords in their RDF."""

    def captioned() -> Iterator[tuple[str, bytes, list[str]]]:
        for path, content in files_of(package, "usr/share/openclipart/svg/", (".svg",)):
            if not _SIGNS.match(path) and (captions := _titles(content)):
                yield path, content, captions

    _write(captioned(), archive)


def repack_stamps(package: Path, archive: Path) -> None:
    """The pictures of Debian's tuxpaint-stamps-default, each by the English sentence beside it."""
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
    # The folder says what kind of thing it is: a Dalmatian lies in "dogs".
    named = (
        (path, content, [captions[stem], path.replace("/cartoon/", "/").split("/")[-2].replace("_", " ")])
        for stem, (path, content) in sorted(pictures.items())
        if captions.get(stem)
    )
    _write(named, archive)


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
    """The title and the keywords of a drawing's RDF, without doubles."""
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
