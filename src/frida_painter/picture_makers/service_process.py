"""Process of one question to a service: sends it, and writes the returned picture file."""

import base64
import binascii
import json
import urllib.error
import urllib.request
from collections.abc import Mapping
from http.client import HTTPException, HTTPMessage, HTTPResponse
from pathlib import Path
from typing import IO, Any
from urllib.parse import urlsplit

from frida_painter import storage
from frida_painter.errors import MakingFailed
from frida_painter.picture_makers.child import run_task, tell
from frida_painter.transfer import TOO_SLOW, Transfer

_CHUNK = 2**20
_MAX_REDIRECTS = 5
_MAX_SAID = 4096  # bytes of a service's sentence about its own fault
_FILE = "picture"


class _SameHost(urllib.request.HTTPRedirectHandler):
    """Redirects: the question is sent again to the same host, and to no other."""

    max_redirections = _MAX_REDIRECTS

    def redirect_request(
        self, req: urllib.request.Request, fp: IO[bytes], code: int, msg: str, headers: HTTPMessage, newurl: str
    ) -> urllib.request.Request:
        """Returns the question for the new address. Raises MakingFailed if that is another host."""
        old, new = urlsplit(req.full_url), urlsplit(newurl)
        if (old.scheme, old.netloc) != (new.scheme, new.netloc):
            raise MakingFailed(
                f"The service {old.netloc} redirects to {new.scheme}://{new.netloc[:80]}, which nobody named; give "
                "that address if you trust it."
            )
        return urllib.request.Request(newurl, data=req.data, headers=dict(req.header_items()), method=req.method)


def _ask(task: Mapping[str, Any], folder: Path) -> dict[str, Any]:
    """Asks once, and writes the picture file. Raises MakingFailed.

    task: address, question, most bytes of a picture file, seconds, and the files of canvas and mask, "" for none
    """
    host = urlsplit(task["address"]).netloc
    question = dict(task["question"])
    if task["canvas"]:  # as the API of the Stable Diffusion web UI has it
        question["init_images"] = [_in_base64(task["canvas"], task["most"])]
    if task["free"]:
        question["mask"] = _in_base64(task["free"], task["most"])
    request = urllib.request.Request(
        task["address"], data=json.dumps(question).encode(), method="POST",
        headers={
            "Content-Type": "application/json", "Accept": "image/*, application/json", "User-Agent": "frida-painter"
        },
    )  # fmt: skip
    # Base64 has four characters for three bytes; the rest is for other fields.
    most = task["most"] * 4 // 3 + _CHUNK
    try:
        with urllib.request.build_opener(_SameHost).open(request, timeout=task["seconds"]) as answer:
            kind = answer.headers.get_content_type()
            if not (kind.startswith("image/") or kind == "application/json"):
                raise MakingFailed(
                    f"The service {host} returned {kind[:60]}, not a picture; it returns image/* or JSON with base64."
                )
            most = task["most"] if kind.startswith("image/") else most
            length = answer.headers.get("Content-Length", "")
            if length.isdecimal() and int(length) > most:
                raise _too_much(host, most)
            size = int(length) if length.isdecimal() else None
            content = _read(answer, host, most, Transfer(f"{host} sent", size, tell))
            if length.isdecimal() and len(content) < int(length):
                raise MakingFailed(
                    f"The service {host} broke off after {len(content)} of {length} bytes; try again, or mend it."
                )
    except urllib.error.HTTPError as cause:
        why = " ".join(str(cause.reason).split())[:80]
        raise MakingFailed(
            f"The service {host} answers {cause.code} {why}{_said_in(cause)}; mend it, or name another."
        ) from cause
    except (HTTPException, OSError, ValueError) as cause:
        reason = cause.reason if isinstance(cause, urllib.error.URLError) else cause
        said = getattr(reason, "strerror", None) or str(reason) or type(reason).__name__
        why = " ".join(said.split())[:160]
        raise MakingFailed(f"The service {host} cannot be asked ({why}); start it, or mend the address.") from cause
    storage.write_bytes(folder / _FILE, content if kind.startswith("image/") else _picture_in(content, host))
    return {}


def _in_base64(file: str, most: int) -> str:
    return base64.b64encode(storage.read_bytes(Path(file), "the canvas", most, MakingFailed)).decode()


def _said_in(fault: urllib.error.HTTPError) -> str:
    """Returns what a service says about its own fault, as the end of a sentence; "" for a page or nothing."""
    try:
        text = fault.read(_MAX_SAID).decode("utf-8", "replace")
    except (HTTPException, OSError, ValueError):
        return ""
    plain = " ".join("".join(mark if mark.isprintable() else " " for mark in text).split())
    return f" ({plain[:160].rstrip('.')})" if plain and not plain.startswith("<") else ""


def _read(answer: HTTPResponse, host: str, most: int, transfer: Transfer) -> bytes:
    """Returns a whole body of at most `most` bytes."""
    chunks, size = [], 0
    while chunk := answer.read1(_CHUNK):  # read would wait until all of it is there
        size += len(chunk)
        if size > most:
            raise _too_much(host, most)
        if not transfer.hear(size):
            raise MakingFailed(f"The service {host} is too slow: {TOO_SLOW}; mend it, or name a quicker one.")
        chunks.append(chunk)
    return b"".join(chunks)


def _too_much(host: str, most: int) -> MakingFailed:
    return MakingFailed(f"The service {host} sends more than {storage.megabytes(most)}; a picture file is smaller.")


def _picture_in(content: bytes, host: str) -> bytes:
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


if __name__ == "__main__":
    run_task(_ask, "The question to the service")
