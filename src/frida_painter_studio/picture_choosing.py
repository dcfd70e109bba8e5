"""Making of pictures from words on the page: makers that the owner allowed, the request, and the choice.

The terminal that starts the studio names the makers, with their commands and addresses. A page knows only labels.
"""

import secrets
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Self
from urllib.parse import urlsplit

from pydantic import BaseModel, ConfigDict, Field

from frida_painter import registry
from frida_painter.errors import ConfigError
from frida_painter.session.events import MadePictures
from frida_painter.system import storage
from frida_painter_studio.reader import check_makers
from frida_painter_studio.studio_folder import MAKING_SUFFIX, CanvasSides
from frida_painter_together.commands import MakerLabel, PlainWords
from frida_painter_together.inbox import MakingOrder

MADE = "made"
"""Folder of all makings in the folder for making pictures, each with a random name."""
MAX_MAKINGS = 8
"""Number of the last makings that are kept to choose from."""
_MAX_FILE = 2**28  # bytes of a made picture
_CLIPS = ("clip-vit-b-32", "clip-vit-l-14")


@dataclass(frozen=True)
class AllowedMakers:
    """Picture makers that visitors may choose.

    by_label: each maker as in `--imagine NAME:TEXT`, by the label that the page shows
    minutes: time for the pictures of some words
    """

    by_label: Mapping[str, str] = field(default_factory=dict)
    minutes: float = 30.0

    @classmethod
    def check(cls, makers: Sequence[str], minutes: float) -> Self:
        """Returns the makers. A short process opens each of them once, so that this process loads no tensors.

        Raises ConfigError if one cannot be opened.
        """
        by_label: dict[str, str] = {}
        if makers:
            check_makers(tuple(makers))
        for maker in makers:
            label, again = label_of(maker), 1
            while label in by_label:
                again += 1
                label = f"{label_of(maker)} ({again})"
            by_label[label] = maker
        return cls(by_label, minutes)

    def order(self, words: str, label: str, **more: Any) -> MakingOrder:
        """Returns the order for pictures. Raises ConfigError if its maker is not allowed here."""
        maker = self.by_label.get(label)
        if maker is None:
            known = ", ".join(self.by_label)
            advice = f"choose one of {known}" if known else "whoever starts the studio allows one with --imagine"
            raise ConfigError(f"There is no picture maker {label[:60]!r} here; {advice}.")
        return MakingOrder(words=words, maker=maker, label=label, minutes=self.minutes, **more)


def label_of(maker: str) -> str:
    """Returns the label of a maker: its name and its program, host or network, without folders and settings."""
    name, _, text = maker.partition(":")
    words = text.split()
    ends = next((at for at, word in enumerate(words) if at and (word.startswith("-") or "{" in word)), len(words))
    shown = [
        (urlsplit(word).hostname if "//" in word else None) or Path(word.strip("'\"").partition(",")[0]).name
        for word in words[: min(2, ends)]
    ]
    return f"{name}: {' '.join(shown)}" if shown else name


class MakingRequest(CanvasSides):
    """Request for pictures of words.

    maker: label of a maker.
    seed: of the first picture.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    words: PlainWords
    maker: MakerLabel
    seed: int = Field(default=0, ge=0, le=2**31 - 1, strict=True)


class ChosenPicture(BaseModel):
    """Choice of a made picture, by the name of its file for the page."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    picture: str = Field(max_length=80)


def take_picture(chosen: ChosenPicture, makings: Sequence[MadePictures], root: Path, pictures: Path) -> dict[str, str]:
    """Copies a made picture to the pictures for goals, with the record of its making.

    root: folder in which the makings name their pictures

    Returns its id, a line about it, and "yes" or "no" if a CLIP is here, which also reads the words.
    Raises ConfigError if it is gone, StorageError.
    """
    found = [(making, one) for making in makings for one in making.pictures if one["picture"] == chosen.picture]
    if not found or not (source := root / str(found[0][1]["file"])).is_file():
        raise ConfigError("This picture is gone; make pictures again.")
    making, one = found[0]
    record = storage.read_json(source.parent / MAKING_SUFFIX.removeprefix("."), "the record of a making")
    record |= {"chosen": source.name, "because": "a person chose it"}
    identifier = secrets.token_hex(16)
    storage.copy(source, pictures / f"{identifier}.png", "a made picture", _MAX_FILE)
    storage.write_json(pictures / f"{identifier}{MAKING_SUFFIX}", record)
    reads = any(registry.are_here(name) for name in _CLIPS)
    told = f"Made from “{making.words}” by {making.maker}, seed {one['seed']}"
    return {"id": identifier, "made": told, "read": "yes" if reads else "no"}
