"""Picture maker `http`: a service of the person's own, which is sent the words and returns a picture."""

import base64
import binascii
import json
import re
import threading
import time
import urllib.error
import urllib.request
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from http.client import HTTPException, HTTPMessage
from pathlib import Path
from queue import Empty, Queue
from typing import IO, Any
from urllib.parse import urlsplit

from frida_painter.errors import ConfigError, MakingFailed
from frida_painter.system import storage
from frida_painter.system.transfer import TOO_SLOW, Transfer
from frida_painter_words.picture_makers.command import plain_line
from frida_painter_words.picture_makers.making import MAX_BYTES, STRENGTH, PictureMakerKind, PictureRequest, make_each

_EXAMPLE = "http:http://localhost:7860/picture"
_GLANCE = 0.05  # seconds between two looks whether the person has stopped
_CHUNK = 2**20
_MAX_REDIRECTS = 5
_MAX_SAID = 4096  # bytes of a service's sentence about its own fault


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
        try:
            parts = urlsplit(address)
            known = parts.scheme in ("http", "https") and bool(parts.hostname) and parts.port != 0
        except ValueError:
            known = False
        if not known or not address.isascii() or any(mark.isspace() or not mark.isprintable() for mark in address):
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
        parts = urlsplit(self.address)
        plain = ", unencrypted" if parts.scheme == "http" else ""
        sent = "Your words, the seed and the size" if request.canvas is None else "Your words and the canvas"
        request.tell(f"{sent} are sent to {parts.netloc}{plain}.")
        return make_each(request, f"The service {parts.netloc}", partial(self._ask, request))

    def _ask(self, request: PictureRequest, number: int, folder: Path, until: float) -> Path:
        """Asks once, in a thread that is left behind if the person stops, or the time is over."""
        parts = urlsplit(self.address)
        if request.canvas is not None:  # of an address that makes pictures from words, the one for pictures
            parts = parts._replace(path=re.sub("txt2img$", "img2img", parts.path))
        address, host, seconds = parts.geturl(), parts.netloc, until - time.monotonic()
        heard = Queue[str | bytes | MakingFailed]()

        def ask() -> None:
            try:
                heard.put(_ask(address, _write_question(request, number), seconds, heard.put))
            except Exception as fault:  # else nobody would hear of it before the time is over
                heard.put(fault if isinstance(fault, MakingFailed) else MakingFailed(f"{host}: {fault!r:.160}"))

        threading.Thread(target=ask, name=f"question to {host}", daemon=True).start()
        answer: str | bytes | MakingFailed = ""
        while isinstance(answer, str):
            try:
                answer = heard.get(timeout=_GLANCE)
            except Empty:
                request.heed(f"The service {host}", until)
            else:
                if isinstance(answer, str):
                    request.tell(answer)
        if isinstance(answer, MakingFailed):
            raise answer
        storage.write_bytes(folder / "picture", answer)
        return folder / "picture"


class _SameHost(urllib.request.HTTPRedirectHandler):
    """Redirects: the question is sent again to the same host, and to no other."""

    max_redirections = _MAX_REDIRECTS

    def redirect_request(
        self, req: urllib.request.Request, fp: IO[bytes], code: int, msg: str, headers: HTTPMessage, newurl: str
    ) -> urllib.request.Request:
        """Returns the question for the new address. Raises MakingFailed if that is another host."""
        old, new = urlsplit(req.full_url), urlsplit(newurl)
        if (old.scheme, old.netloc) != (new.scheme, new.netloc):
            fp.close()
            raise MakingFailed(
                f"The service {old.netloc} redirects to {new.scheme}://{new.netloc[:80]}, which nobody named; give "
                "that address if you trust it."
            )
        return urllib.request.Request(newurl, data=req.data, headers=dict(req.header_items()), method=req.method)


def _write_question(request: PictureRequest, number: int) -> dict[str, Any]:
    """Returns what a service is sent; the canvas as the API of the Stable Diffusion web UI has it."""
    sent: dict[str, Any] = {"words": request.words, "prompt": request.words, "seed": request.seeds[number]}
    sent |= {"width": request.width, "height": request.height}
    coded = {
        name: base64.b64encode(storage.read_bytes(file, "the canvas", MAX_BYTES, MakingFailed)).decode()
        for name, file in (("canvas", request.canvas), ("mask", request.free))
        if file is not None
    }
    if "canvas" in coded:
        sent |= {"denoising_strength": STRENGTH, "init_images": [coded.pop("canvas")]}
    return sent | coded


def _ask(address: str, question: Mapping[str, Any], seconds: float, tell: Callable[[str], None]) -> bytes:
    """Asks a service once, and returns the picture file. Raises MakingFailed."""
    host = urlsplit(address).netloc
    headers = {"Content-Type": "application/json", "Accept": "image/*, application/json", "User-Agent": "frida-painter"}
    request = urllib.request.Request(address, json.dumps(question).encode(), headers, method="POST")
    try:
        with urllib.request.build_opener(_SameHost).open(request, timeout=seconds) as answer:
            kind = answer.headers.get_content_type()
            if not (kind.startswith("image/") or kind == "application/json"):
                raise MakingFailed(
                    f"The service {host} returned {kind[:60]}, not a picture; it returns image/* or JSON with base64."
                )
            # Base64 has four characters for three bytes; the rest is for other fields.
            most = MAX_BYTES if kind.startswith("image/") else MAX_BYTES * 4 // 3 + _CHUNK
            length = answer.headers.get("Content-Length", "")
            size = int(length) if length.isdecimal() else None
            if size is not None and size > most:
                raise _too_much(host, most)
            transfer, content = Transfer(f"{host} sent", size, tell), bytearray()
            while chunk := answer.read1(_CHUNK):  # read would wait until all of it is there
                content += chunk
                if len(content) > most:
                    raise _too_much(host, most)
                if not transfer.hear(len(content)):
                    raise MakingFailed(f"The service {host} is too slow: {TOO_SLOW}; mend it, or name a quicker one.")
            if size is not None and len(content) < size:
                raise MakingFailed(
                    f"The service {host} broke off after {len(content)} of {size} bytes; try again, or mend it."
                )
    except urllib.error.HTTPError as cause:
        with cause:
            why = " ".join(str(cause.reason).split())[:80] + _said_in(cause)
        raise MakingFailed(f"The service {host} answers {cause.code} {why}; mend it, or name another.") from cause
    except (HTTPException, OSError, ValueError) as cause:
        reason = cause.reason if isinstance(cause, urllib.error.URLError) else cause
        said = getattr(reason, "strerror", None) or str(reason) or type(reason).__name__
        why = " ".join(said.split())[:160]
        raise MakingFailed(f"The service {host} cannot be asked ({why}); start it, or mend the address.") from cause
    return bytes(content) if kind.startswith("image/") else _picture_in(content, host)


def _said_in(fault: urllib.error.HTTPError) -> str:
    """Returns what a service says about its own fault, as the end of a sentence; "" for a page or nothing."""
    try:
        text = fault.read(_MAX_SAID).decode("utf-8", "replace")
    except (HTTPException, OSError, ValueError):
        return ""
    plain = plain_line(text)
    return f" ({plain[:160].rstrip('.')})" if plain and not plain.startswith("<") else ""


def _too_much(host: str, most: int) -> MakingFailed:
    return MakingFailed(f"The service {host} sends more than {storage.megabytes(most)}; a picture file is smaller.")


def _picture_in(content: bytearray, host: str) -> bytes:
    """Returns the picture file in a JSON answer: image, the only one of images, or data[0].b64_json."""
    try:
        body = json.loads(content)
        found = body["image"] if "image" in body else body["images"] if "images" in body else body["data"]
        if isinstance(found, list):
            if len(found) != 1:
                raise MakingFailed(
                    f"The service {host} returned {storage.count_of(len(found), 'picture')} for one "
                    "seed; it returns one."
                )
            found = found[0]["b64_json"] if isinstance(found[0], dict) else found[0]
        return base64.b64decode(found.partition(",")[2] if found.startswith("data:") else found, validate=True)
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError, binascii.Error) as cause:
        raise MakingFailed(
            f"The service {host} returned JSON without a picture; it holds base64 as image, or one in images."
        ) from cause


HTTP = PictureMakerKind(
    "http",
    "A service of yours at an address: it is sent JSON with words, seed, width and height, and returns a picture file, "
    "or JSON with one in base64 as image. In a painting it is sent the canvas too, as init_images.",
    ServiceMaker.parse,
    lambda text: True,
)
