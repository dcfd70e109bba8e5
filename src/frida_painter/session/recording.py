"""A stroke library while it is being painted: every stroke on the disk as soon as it is photographed.

The strokes stand in a folder beside the library until all are there. Whoever paints the library
again after a crash goes on where it ended.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch

from frida_painter import storage, tensor_file
from frida_painter.brush.flaw import Flaw
from frida_painter.brush.kinds import BrushKind
from frida_painter.errors import ConfigError, LibraryError
from frida_painter.session.paper import Print

_FORMAT = "frida-painter recording"
_VERSION = 1


@dataclass(frozen=True)
class RecordingSettings:
    """What decides a recording: the easel, the brush, `count` strokes drawn with `seed`, and the strokes per dip."""

    easel: str
    kind: BrushKind
    count: int
    seed: int
    refill_every: int

    def record(self) -> dict[str, object]:
        """The settings as plain values."""
        limits = self.kind.limits
        return {
            "format": _FORMAT,
            "version": _VERSION,
            "easel": self.easel,
            "brush": self.kind.name,
            "width": self.kind.width,
            "lengths": list(limits.length),
            "bends": list(limits.bend),
            "count": self.count,
            "seed": self.seed,
            "refill_every": self.refill_every,
        }


class Recording:
    """The strokes of one recording that are painted so far, by number.

    folder: where they are kept, None for nowhere. Raises ConfigError where the folder holds those of
    another recording, StorageError where it cannot be written or is damaged.
    """

    def __init__(self, folder: Path | None, settings: RecordingSettings, shape: tuple[int, int]) -> None:
        self.settings = settings
        self._folder = folder
        self._shape = shape
        self.prints: dict[int, Print] = {}
        if folder is not None and (folder / "order.json").exists():
            self._require_same(folder)
            self.prints = {
                number: kept for number in range(settings.count) if (kept := self._kept(self._path(folder, number)))
            }
        elif folder is not None:
            storage.write_json(folder / "order.json", settings.record())

    @property
    def missing(self) -> list[int]:
        """Numbers of the strokes that are still to be painted."""
        return [number for number in range(self.settings.count) if number not in self.prints]

    def keep(self, number: int, stroke: Print) -> None:
        """Puts a stroke to the others, on the disk first. Raises StorageError."""
        if self._folder is not None:
            mark = {"mark": torch.from_numpy(stroke.mark)}
            words = {"flaw": stroke.flaw.name, "since_dip": repr(stroke.since_dip)}
            tensor_file.write_tensors(self._path(self._folder, number), mark, words)
        self.prints[number] = stroke

    def discard(self, numbers: list[int]) -> None:
        """Forgets strokes that are to be painted again."""
        for number in numbers:
            del self.prints[number]
            if self._folder is not None:
                self._path(self._folder, number).unlink(missing_ok=True)

    def clear_away(self) -> None:
        """Removes the folder, once the library is written."""
        if self._folder is None:
            return
        for number in range(self.settings.count):
            self._path(self._folder, number).unlink(missing_ok=True)
        # The settings go last: without them the strokes would be nobody's.
        (self._folder / "order.json").unlink(missing_ok=True)
        if not any(self._folder.iterdir()):
            self._folder.rmdir()

    @staticmethod
    def _path(folder: Path, number: int) -> Path:
        return folder / f"stroke-{number:05d}.safetensors"

    def _require_same(self, folder: Path) -> None:
        found = storage.read_json(folder / "order.json", "the settings of a recording")
        wanted = self.settings.record()
        differing = [name for name in wanted if found.get(name) != wanted[name]]
        if differing:
            told = ", ".join(f"{name} {found.get(name)} and not {wanted[name]}" for name in differing)
            raise ConfigError(
                f"{folder} holds the strokes of a recording that was broken off, of another kind: {told}. Ask for the "
                "same again to finish it, choose another file with --out, or remove that folder."
            )

    def _kept(self, path: Path) -> Print | None:
        """A stroke as it was kept; None where there is none, or a damaged one, which is then painted again."""
        if not path.exists():
            return None
        try:
            tensors, words = tensor_file.read_tensors(path, "a recorded stroke", LibraryError)
            mark, flaw, since_dip = tensors["mark"].numpy(), Flaw[words["flaw"]], float(words["since_dip"])
        except (LibraryError, KeyError, ValueError):
            return None
        return Print(mark, flaw, since_dip) if mark.shape == self._shape and mark.dtype == np.uint8 else None
