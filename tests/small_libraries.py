"""Picture libraries of a few pictures, packed as the real ones are: Debian packages and npm archives.

Every picture is a disc of DISC on a plain or transparent ground.
"""

import io
import tarfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass

from PIL import Image, ImageDraw

DISC = "#d02030"


@dataclass(frozen=True)
class SmallLibrary:
    """A library's package. file: its name; captions: what is to be known of it, by the names of its pictures."""

    file: str
    content: bytes
    captions: Mapping[str, tuple[str, ...]]


def tar_of(files: Mapping[str, bytes], packed_as: str) -> bytes:
    """A tar with these files; packed_as: gz or xz."""
    memory = io.BytesIO()
    with tarfile.open(fileobj=memory, mode=f"w:{packed_as}") as archive:
        for name, content in files.items():
            member = tarfile.TarInfo(name)
            member.size = len(content)
            archive.addfile(member, io.BytesIO(content))
    return memory.getvalue()


def debian(files: Mapping[str, bytes]) -> bytes:
    """A Debian package that installs these files."""
    packed = b"!<arch>\n"
    control = tar_of({"./control": b"Package: small\n"}, "xz")
    data = tar_of({f"./{name}": content for name, content in files.items()}, "xz")
    for name, part in (("debian-binary", b"2.0\n"), ("control.tar.xz", control), ("data.tar.xz", data)):
        packed += f"{name:<16}{'0':<12}{'0':<6}{'0':<6}{'100644':<8}{len(part):<10}`\n".encode()
        packed += part + b"\n" * (len(part) % 2)
    return packed


def disc(form: str) -> bytes:
    """A picture of 128 pixels; form: PNG and WEBP are transparent around the disc, JPEG has a white ground."""
    clear = form in ("PNG", "WEBP")
    picture = Image.new("RGBA" if clear else "RGB", (128, 128), (0, 0, 0, 0) if clear else "white")
    ImageDraw.Draw(picture).ellipse((16, 16, 112, 112), fill=DISC)
    memory = io.BytesIO()
    fine = {"WEBP": {"lossless": True}, "JPEG": {"quality": 98, "subsampling": 0}}
    picture.save(memory, form, **fine.get(form, {}))
    return memory.getvalue()


def drawing(title: str = "", *keywords: str) -> bytes:
    """An SVG as the Open Clip Art Library has them, with a title and keywords in its RDF."""
    said = "".join(f"<rdf:li>{word}</rdf:li>" for word in keywords)
    return (
        '<svg xmlns="http://www.w3.org/2000/svg" xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#" '
        'xmlns:dc="http://purl.org/dc/elements/1.1/" xmlns:cc="http://web.resource.org/cc/" viewBox="0 0 64 64">'
        f"<metadata><rdf:RDF><cc:Work><dc:title>{title}</dc:title><dc:subject><rdf:Bag>{said}</rdf:Bag></dc:subject>"
        f'</cc:Work></rdf:RDF></metadata><circle cx="32" cy="32" r="24" fill="{DISC}"/></svg>'
    ).encode()


def _openclipart() -> SmallLibrary:
    below = "usr/share/openclipart/svg/"
    files = {
        "animals/fox.svg": drawing("Red_Fox", "Animal", "forest"),
        "food/pear.svg": drawing("pear"),
        "signs_and_symbols/stop.svg": drawing("stop"),
        "animals/untitled.svg": drawing(),
    }
    captions = {"animals/fox.svg": ("Red Fox", "animal", "forest"), "food/pear.svg": ("pear",)}
    packed = debian({below + name: content for name, content in files.items()})
    return SmallLibrary("openclipart-svg_9.99_all.deb", packed, captions)


def _stamps() -> SmallLibrary:
    below = "usr/share/tuxpaint/stamps/"
    files = {
        "animals/dogs/dalmatian.png": disc("PNG"),
        "animals/dogs/dalmatian.txt": b"A Dalmatian.\nes.utf8=Un dalmata\n",
        "animals/birds/cartoon/owl.svg": drawing(),
        "animals/birds/cartoon/owl.txt": b"An owl.\n",
        "animals/birds/cartoon/owl.wav": b"RIFF",
        "symbols/heart.png": disc("PNG"),
        "symbols/heart.txt": b"A heart.\n",
        "food/unnamed.png": disc("PNG"),
    }
    captions = {
        "animals/dogs/dalmatian.png": ("A Dalmatian", "dogs"),
        "animals/birds/cartoon/owl.svg": ("An owl", "birds"),
    }
    packed = debian({below + name: content for name, content in files.items()})
    return SmallLibrary("tuxpaint-stamps-default_9.99_all.deb", packed, captions)


def _abcs() -> SmallLibrary:
    below = "usr/share/qabcs/abcs/all/pics/"
    files = {"animals/giant_panda.png": disc("PNG"), "toys/ursula.png": disc("PNG"), "food/apple.txt": b"apple"}
    packed = debian({below + name: content for name, content in files.items()})
    return SmallLibrary("qabcs-data_9.99_all.deb", packed, {"animals/giant_panda.png": ("giant panda", "animals")})


def _flashcards() -> SmallLibrary:
    below = "usr/share/games/pysiogame/res/images/art4apps/"
    files = {"fruit_n_veg/pear.jpg": disc("JPEG"), "body/knee.jpg": disc("JPEG")}
    packed = debian({below + name: content for name, content in files.items()})
    captions = {"cartoon/fruit_n_veg/pear.jpg": ("pear", "fruit and veg")}
    return SmallLibrary("pysiogame_9.99_all.deb", packed, captions)


def _fluent() -> SmallLibrary:
    names = ("1f9a2", "1f474-1f3fb", "2602-fe0f")
    packed = tar_of({f"package/assets/{name}.webp": disc("WEBP") for name in names}, "gz")
    captions = {"cartoon/1f9a2.webp": ("swan",), "cartoon/2602-fe0f.webp": ("umbrella",)}
    return SmallLibrary("fluent-emoji-3d-9.9.9.tgz", packed, captions)


MAKERS: dict[str, Callable[[], SmallLibrary]] = {
    "openclipart": _openclipart,
    "stamps": _stamps,
    "abcs": _abcs,
    "flashcards": _flashcards,
    "fluent": _fluent,
}
