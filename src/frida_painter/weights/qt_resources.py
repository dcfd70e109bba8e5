"""Qt's compiled resources (.rcc): a tree of names, and the files that its leaves hold.

The format is that of Qt's QResource (qtbase, `src/corelib/io/qresource.cpp`): big-endian numbers, names in UTF-16,
files as they are or packed with zlib.
"""

import struct
import zlib
from collections.abc import Iterator

from frida_painter.weights.debian import LONGEST

_MAGIC = b"qres"
_PACKED, _FOLDER, _ZSTANDARD = 1, 2, 4
_NODE = {1: 14, 2: 22, 3: 22}  # bytes of a node, by the version of the format
_DEEPEST, _MOST = 32, 100_000


def files_in(resources: bytes) -> Iterator[tuple[str, bytes]]:
    """The files of a compiled resource by their paths, without those that are packed in another way or above 8 MB.

    Raises ValueError where it is damaged.
    """
    try:
        magic, version, tree, content, names = struct.unpack_from(">4s4I", resources)
        if magic != _MAGIC or version not in _NODE:
            raise ValueError("it is no Qt resource of a known version")
        yield from _Tree(resources, tree, content, names, _NODE[version]).below(0, "", _DEEPEST)
    except (struct.error, UnicodeDecodeError, zlib.error) as cause:
        raise ValueError(f"it is a damaged Qt resource ({cause})") from cause


class _Tree:
    """The parts of a resource: where its nodes, the contents of its files and their names begin."""

    def __init__(self, resources: bytes, tree: int, content: int, names: int, size: int) -> None:
        self._bytes, self._tree, self._content, self._names, self._size = resources, tree, content, names, size
        self._seen = 0

    def below(self, number: int, path: str, deepest: int) -> Iterator[tuple[str, bytes]]:
        """The files of a node and of all below it."""
        self._seen += 1
        if deepest == 0 or self._seen > _MOST:  # a tree that leads back into itself
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
            if (file := _unpacked(packed) if flags & _PACKED else packed) is not None:
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


def _unpacked(packed: bytes) -> bytes | None:
    """A file that zlib packed, after the four bytes of its length; None where it is larger than 8 MB."""
    unpacking = zlib.decompressobj()
    file = unpacking.decompress(packed[4:], LONGEST)
    return file if not unpacking.unconsumed_tail else None
