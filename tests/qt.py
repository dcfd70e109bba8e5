"""Compiled resources of Qt, written by the format's description."""

import struct
import zlib

Tree = dict[str, "Tree | bytes"]


def resource(tree: Tree, version: int = 2, flags: int = 1) -> bytes:
    """A resource of these files; flags: of each file, 1 packed with zlib, 4 with Zstandard, 0 as it is."""
    names, contents, nodes = b"", b"", [b""]
    waiting: list[tuple[int, str, Tree | bytes]] = [(0, "", tree)]
    while waiting:
        at, name, here = waiting.pop(0)
        named = len(names)
        names += struct.pack(">HI", len(name), 0) + name.encode("utf-16-be")
        if isinstance(here, bytes):
            file = struct.pack(">I", len(here)) + zlib.compress(here) if flags & 1 else here
            nodes[at] = struct.pack(">IHHHI", named, flags, 0, 0, len(contents))
            contents += struct.pack(">I", len(file)) + file
        else:
            nodes[at] = struct.pack(">IHII", named, 2, len(here), len(nodes))
            for child, below in here.items():
                waiting.append((len(nodes), child, below))
                nodes.append(b"")
        if version > 1:
            nodes[at] += bytes(8)
    head = 20
    packed = b"".join(nodes)
    places = head, head + len(packed), head + len(packed) + len(contents)
    return b"qres" + struct.pack(">4I", version, *places) + packed + contents + names
