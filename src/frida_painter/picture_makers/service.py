"""Picture maker `http`: a service of the person's own, which is sent the words and returns a picture."""

import re
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import SplitResult, urlsplit, urlunsplit

from frida_painter.errors import ConfigError, MakingFailed
from frida_painter.picture_makers.making import MAX_BYTES, STRENGTH, PictureMakerKind, PictureRequest, make_each
from frida_painter.picture_makers.program import run_child

_EXAMPLE = "http:http://localhost:7860/picture"


@dataclass(frozen=True)
class ServiceMaker:
    """Address that is asked once for each picture.

    address: http or https
    """

    address: str

    @classmethod
    def parse(cls, text: str) -> "ServiceMaker":
        """Returns the maker of an address; "//HOST/..." is one of http. Asks nothing. Raises ConfigError."""
        address = f"http:{text}" if text.startswith("//") else text
        parts = _split(address)
        if (
            parts is None
            or parts.scheme not in ("http", "https")
            or not parts.hostname
            or not address.isascii()
            or any(mark.isspace() or not mark.isprintable() for mark in address)
        ):
            raise ConfigError(f"{text[:80]!r} is no address of a service; write for example {_EXAMPLE}.")
        if parts.username is not None or parts.password is not None:
            raise ConfigError(
                "The address of the service holds a name or a password, which the painting's record would keep; give "
                "one without."
            )
        return cls(address)

    @property
    def facts(self) -> Mapping[str, str]:
        """Address, without what follows the path: a key may stand there."""
        parts = urlsplit(self.address)
        return {"address": f"{parts.scheme}://{parts.netloc}{parts.path}"}

    def make(self, request: PictureRequest) -> Sequence[Path | MakingFailed]:
        """Returns a picture file for each seed, or a reason. Raises Interrupted."""
        until = time.monotonic() + request.seconds
        parts = urlsplit(self.address)
        plain = ", unencrypted" if parts.scheme == "http" else ""
        sent = "Your words, the seed and the size" if request.canvas is None else "Your words and the canvas"
        request.tell(f"{sent} are sent to {parts.netloc}{plain}.")
        return make_each(request, lambda number: self._ask(request, number, until))

    @property
    def _address_for_canvas(self) -> str:
        """Address that makes pictures from a picture: of txt2img, it is img2img."""
        parts = urlsplit(self.address)
        return urlunsplit(parts._replace(path=re.sub("txt2img$", "img2img", parts.path)))

    def _ask(self, request: PictureRequest, number: int, until: float) -> Path:
        host, count = urlsplit(self.address).netloc, len(request.seeds)
        request.tell(f"{host} makes picture {number + 1} of {count}.")
        folder = request.folder / str(number + 1)
        question = {
            "words": request.words, "prompt": request.words, "seed": request.seeds[number],
            "width": request.width, "height": request.height,
            **({} if request.canvas is None else {"denoising_strength": STRENGTH}),
        }  # fmt: skip
        task = {
            "address": self.address if request.canvas is None else self._address_for_canvas,
            "question": question, "most": MAX_BYTES, "seconds": max(0.1, until - time.monotonic()),
            "canvas": str(request.canvas or ""), "free": str(request.free or ""),
        }  # fmt: skip
        run_child(
            "frida_painter.picture_makers.service_process", f"The service {host}", task, folder, request, until,
            made=folder / "picture",
        )  # fmt: skip
        return folder / "picture"


def _split(address: str) -> SplitResult | None:
    """Returns the parts of an address, None if it has none."""
    try:
        parts = urlsplit(address)
        return parts if parts.port != 0 else None
    except ValueError:
        return None


HTTP = PictureMakerKind(
    "http",
    "A service of yours at an address: it is sent JSON with words, seed, width and height, and returns a picture file, "
    "or JSON with one in base64 as image. In a painting it is sent the canvas too, as init_images.",
    ServiceMaker.parse,
    lambda text: True,
)
