"""What a long experiment has finished, kept on the disk so that one that was interrupted goes on from there."""

import hashlib
import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

from torch import Tensor

from frida_painter import images, storage
from frida_painter.errors import ImageError, StorageError


@dataclass(frozen=True)
class Measurement:
    """What one part of an experiment measured: numbers by name, and pictures [3, H, W] by name."""

    numbers: Mapping[str, float]
    pictures: Mapping[str, Tensor]


class ResultCache:
    """Findings by name in a folder, each with all that it depends on; `folder` None: nothing is kept.

    A finding that depended on something else, or is damaged, counts as not there.
    """

    def __init__(self, folder: Path | None, depends_on: Mapping[str, object]) -> None:
        self._folder = folder
        self._depends_on = hashlib.sha256(json.dumps(depends_on, sort_keys=True).encode()).hexdigest()

    def recall(self, name: str, measure: Callable[[], Measurement]) -> Measurement:
        """The finding of that name; measured, and kept, where it is not there. Pictures come back in 8 bits."""
        if self._folder is None:
            return measure()
        kept = self._read(self._folder, name)
        if kept is not None:
            return kept
        finding = measure()
        for picture_name, picture in finding.pictures.items():
            images.save(picture, self._folder / f"{name}-{picture_name}.png")
        storage.write_json(
            self._folder / f"{name}.json",
            {"of": self._depends_on, "numbers": dict(finding.numbers), "pictures": list(finding.pictures)},
        )
        return finding

    def _read(self, folder: Path, name: str) -> Measurement | None:
        try:
            record = storage.read_json(folder / f"{name}.json", "a finding of an experiment")
            if record["of"] != self._depends_on:
                return None
            pictures = {part: images.load(folder / f"{name}-{part}.png") for part in record["pictures"]}
        except (StorageError, ImageError, KeyError):
            return None
        return Measurement(record["numbers"], pictures)
