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
            caption = _CAPTIONERS.get(rules["captions"])
            captioned = ((*file, caption(*file)) for file in files) if caption else _by_sentences(files)
            for path, content, said in captioned:
                name = f"cartoon/{path}" if rules.get("drawn") else path
                if said and name not in captions:
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


def _by_name(path: str, content: bytes) -> list[str]:
    folder, _, name = path.rpartition(".")[0].replace("_n_", "_and_").replace("_", " ").rpartition("/")
    return [name, folder]


def _by_character(path: str, content: bytes) -> list[str]:
    """Returns the Unicode name of the character whose hexadecimal number is the file name; none for several."""
    marks = [mark for mark in path.rpartition(".")[0].upper().split("-") if mark != "FE0F"]
    if len(marks) != 1 or not re.fullmatch("[0-9A-F]{4,6}", marks[0]) or int(marks[0], 16) > 0x10FFFF:
        return []
    name = unicodedata.name(chr(int(marks[0], 16)), "").lower()
    return [name] if name else []


def _by_title(path: str, content: bytes) -> list[str]:
    try:
        work = ElementTree.fromstring(content).find(f".//{_WORK}")
    except ElementTree.ParseError:
        return []
    if work is None:
        return []
    title = " ".join((work.findtext(f"{_DUBLIN_CORE}title") or "").replace("_", " ").split())
    items = work.findall(f"{_DUBLIN_CORE}subject//{_RDF}li")
    keywords = [" ".join((item.text or "").split()).lower() for item in items]
    return [one for one in dict.fromkeys([title, *keywords]) if re.search("[A-Za-z]{2}", one)][:12]


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


_CAPTIONERS: Mapping[str, Callable[[str, bytes], list[str]]] = {
    "names": _by_name,
    "characters": _by_character,
    "titles": _by_title,
}
"""Functions that return the captions of a picture; none leave it out."""
