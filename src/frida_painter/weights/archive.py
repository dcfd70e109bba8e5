"""Picture libraries in one format: a zip of pictures with their captions in `captions.json`.

A library comes as a package of Debian (an ar archive with a tar inside, deb(5)) or of npm (a tar). The catalogue has
the folder of its pictures, the endings of their file names, a pattern of those to leave out, and the kind of captions.
"""

import json
import re
import tarfile
import unicodedata
import zipfile
import zlib
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

from frida_painter.errors import WeightsError
from frida_painter.weights.catalogue import PICTURES as FILE

__all__ = ["CAPTIONS", "FILE", "repack"]

CAPTIONS = "captions.json"
_MAX_PICTURE = 2**23  # bytes
_AR, _AR_HEADER = b"!<arch>\n", 60  # first bytes of an ar archive, and the bytes of a member's header
_DUBLIN_CORE, _RDF = "{http://purl.org/dc/elements/1.1/}", "{http://www.w3.org/1999/02/22-rdf-syntax-ns#}"
_WORK = "{http://web.resource.org/cc/}Work"

Files = Iterator[tuple[str, bytes]]
"""Paths of files below the library's folder, and their contents."""
Captioned = Iterator[tuple[str, bytes, list[str]]]


def repack(package: Path, archive: Path, rules: Mapping[str, Any]) -> None:
    """Writes the pictures of a package that have captions. Raises WeightsError if it is damaged, or has none.

    rules: of the catalogue
    """
    captions: dict[str, list[str]] = {}
    try:
        with zipfile.ZipFile(archive, "w", zipfile.ZIP_DEFLATED) as packed:
            files = _read_package(package, rules["below"], tuple(rules["endings"]), rules.get("without"))
            for path, content, said in _CAPTIONERS[rules["captions"]](files):
                name = f"cartoon/{path}" if rules.get("drawn") else path
                if name not in captions:
                    packed.writestr(name, content)
                    captions[name] = said
            packed.writestr(CAPTIONS, json.dumps(captions))
    except (OSError, EOFError, tarfile.TarError, zlib.error, ValueError) as cause:
        raise WeightsError(f"{package.name} is a damaged package ({cause})") from cause
    if not captions:
        raise WeightsError("it holds no picture with a caption")


def _read_package(package: Path, below: str, endings: tuple[str, ...], without: str | None) -> Files:
    """Yields the regular files below a folder, in the order of the archive; links and files above 8 MB are skipped."""
    with package.open("rb") as file:
        _find_tar(file)
        with tarfile.open(fileobj=file, mode="r|*") as archive:
            for member in archive:
                path = member.name.removeprefix("./")
                if not member.isreg() or not path.startswith(below) or not path.endswith(endings):
                    continue
                path = path.removeprefix(below)
                content = archive.extractfile(member) if member.size <= _MAX_PICTURE else None
                if content is not None and not (without and re.match(without, path)):
                    yield path, content.read()


def _find_tar(file: Any) -> None:
    """Moves to the tar of a Debian package's files; any other file is a tar itself. Raises ValueError."""
    if file.read(len(_AR)) != _AR:
        file.seek(0)
        return
    while header := file.read(_AR_HEADER):
        if header.startswith(b"data.tar"):
            return
        size = int(header[48:58])
        file.seek(size + size % 2, 1)
    raise ValueError("it has no data.tar")


def _by_names(files: Files) -> Captioned:
    """Yields pictures with their file name and folder as captions."""
    for path, content in files:
        folder, _, name = path.rpartition(".")[0].replace("_n_", "_and_").replace("_", " ").rpartition("/")
        yield path, content, [name, folder]


def _by_characters(files: Files) -> Captioned:
    """Yields pictures whose file names are the numbers of characters, with the Unicode names of these."""
    for path, content in files:
        if said := character_name(path.rpartition(".")[0]):
            yield path, content, [said]


def _by_titles(files: Files) -> Captioned:
    """Yields drawings with the title and the keywords in their RDF."""
    for path, content in files:
        try:
            work = ElementTree.fromstring(content).find(f".//{_WORK}")
        except ElementTree.ParseError:
            continue
        if work is not None:
            title = " ".join((work.findtext(f"{_DUBLIN_CORE}title") or "").replace("_", " ").split())
            items = work.findall(f"{_DUBLIN_CORE}subject//{_RDF}li")
            keywords = [" ".join((item.text or "").split()).lower() for item in items]
            said = [one for one in dict.fromkeys([title, *keywords]) if re.search("[A-Za-z]{2}", one)][:12]
            if said:
                yield path, content, said


def _by_sentences(files: Files) -> Captioned:
    """Yields pictures with the English sentence beside them, and their folder: a Dalmatian lies in "dogs"."""
    pictures: dict[str, tuple[str, bytes]] = {}
    captions: dict[str, str] = {}
    for path, content in files:
        stem, _, kind = path.rpartition(".")
        if kind == "txt":
            captions[stem] = content.decode("utf-8", "replace").splitlines()[0].strip().rstrip(".") if content else ""
        elif kind == "png" or stem not in pictures:
            pictures[stem] = path, content
    for stem, (path, content) in sorted(pictures.items()):
        if captions.get(stem):
            yield path, content, [captions[stem], path.replace("/cartoon/", "/").split("/")[-2].replace("_", " ")]


_CAPTIONERS: Mapping[str, Callable[[Files], Captioned]] = {
    "names": _by_names,
    "characters": _by_characters,
    "titles": _by_titles,
    "sentences": _by_sentences,
}


def character_name(code: str) -> str:
    """Returns the Unicode name of a character from its hexadecimal number; "" for several characters, or none."""
    marks = [mark for mark in code.upper().split("-") if mark != "FE0F"]
    if len(marks) != 1 or not re.fullmatch("[0-9A-F]{4,6}", marks[0]) or int(marks[0], 16) > 0x10FFFF:
        return ""
    return unicodedata.name(chr(int(marks[0], 16)), "").lower()
