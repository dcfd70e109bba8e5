"""Files of a person, with names like those of the program, that no cleaning may touch."""

import hashlib
from pathlib import Path

NAMES = (
    ".old-painting", ".backup-20261129.zip", ".git/.pack-abcdefgh", ".notes-a1b2c3d4.txt", ".sweep-ab12cd34.json",
    "cat-2.json", "cat-0123456789ab.safetensors", "cat-brush.safetensors", "plan-brush.safetensors",
    "weights.safetensors", "stroke-9.safetensors", "notes.txt", "unfinished/mine.txt", "looks/used/mine.jpg",
    "found-corners-mine.png", "setup-mine.png", "made-mine-1.jpg", "strokes.npz", "photographs/.kept-abcdefgh.png",
    "sketchbook/mine.jpg", "painting.frida-painter-part-.png",
)  # fmt: skip


def files_of_a_person(folder: Path) -> list[Path]:
    """Writes the files into a folder, and a link to one outside; returns their paths."""
    found = [folder / name for name in NAMES]
    for path in found:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(_content(path))
    link = folder / "linked"
    link.symlink_to(found[-1])
    return [*found, link]


def require_untouched(files: list[Path]) -> None:
    """Fails unless all of them are as they were written."""
    changed = [str(path) for path in files if not path.is_file() or path.read_bytes() != _content(path.resolve())]
    assert not changed, changed


def _content(path: Path) -> bytes:
    return hashlib.sha256(str(path).encode()).digest()
