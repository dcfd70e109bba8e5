"""A picture maker: a sky above land, in colours that follow from the words and the seed; it needs no network."""

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import torch

import frida_painter as fp
from frida_painter.plugins import ConfigError, Interrupted, PictureMakerKind, PictureRequest


@dataclass(frozen=True)
class Gradient:
    """Makes pictures with the horizon at `horizon` of their height, from the top. 0 < horizon < 1."""

    horizon: float = 0.6

    @classmethod
    def parse(cls, text: str) -> "Gradient":
        """Returns the maker of "gradient" or "gradient:HORIZON". Raises ConfigError."""
        try:
            horizon = float(text or 0.6)
        except ValueError:
            horizon = 0.0
        if not 0 < horizon < 1:
            raise ConfigError(f"A horizon of {text[:40]!r} was given; it is between 0 and 1, such as gradient:0.6.")
        return cls(horizon)

    @property
    def facts(self) -> Mapping[str, str]:
        """Facts about what made the pictures, for the record of the painting."""
        return {"horizon": f"horizon at {self.horizon:g}"}

    def make(self, request: PictureRequest) -> Sequence[Path]:
        """One file for each seed, in their order. A stop is heard between two pictures."""
        files = []
        for number, seed in enumerate(request.seeds, 1):
            if request.stop_asked():
                raise Interrupted("You stopped the making of pictures.")
            request.tell(f"gradient makes picture {number} of {len(request.seeds)}.")
            known = hashlib.sha256(f"{seed} {request.words}".encode()).digest()
            top, low, land = torch.tensor([byte / 255 for byte in known[:9]]).reshape(3, 3, 1, 1)
            down = ((torch.arange(request.height) + 0.5) / request.height)[:, None].expand(-1, request.width)
            share = (down / self.horizon).clamp(max=1)
            picture = torch.where(down < self.horizon, top + share * (low - top), land)
            files.append(request.folder / f"{number}.png")
            fp.save_picture(picture, files[-1])
        return files


KIND = PictureMakerKind("gradient", "A sky above land in colours that follow from the words.", Gradient.parse)
