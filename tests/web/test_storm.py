"""Requests of all kinds, most of them senseless: none is answered with an accident, and none learns a path."""

import json
import random
from pathlib import Path
from typing import Any

import pytest

from frida_painter.web import limits
from frida_painter.web.workers import Place
from studios import Studio, Visitor

COUNT = 1500
NASTY = [
    "",
    " ",
    "..",
    "../../etc/passwd",
    "%2e%2e%2f",
    "\\\\host\\share",
    "C:\\x",
    "a\x00b",
    "<script>alert(1)</script>",
    "{{7*7}}",
    "' OR 1=1",
    "\x1b[2J",
    "ä" * 300,
    "𝕏",
    "\u202e",
    "NaN",
    "1e999",
    "-1",
    "0",
    "null",
    "9" * 40,
    "0" * 32,
    "0" * 16,
    "live",
    "painting",
    "1",
    "plan.jpg",
]
BODIES = [
    b"",
    b"{",
    b"[]",
    b"null",
    b'"x"',
    b"\xff\xfe\x00",
    b'{"a":' * 3000,
    b"[" * 3000,
    b"--x\r\nContent-Disposition: form-data; name=a\r\n\r\n",
    b"\x89PNG\r\n\x1a\n" + b"\0" * 40,
    b"GIF89a",
    b"<svg/>",
    b"x" * 5000,
    b'{"terms": [{"kind": "text", "words": "\\ud800"}]}',
]
TYPES = [
    "application/json",
    "multipart/form-data",
    "multipart/form-data; boundary=x",
    "text/plain",
    "image/png",
    "x",
    "",
]


def nonsense(chance: random.Random, depth: int = 0) -> Any:
    """Some JSON value."""
    kinds = [*NASTY, chance.randint(-5, 10**6), chance.random() * 1e9, True, None]
    if depth < 3 and chance.random() < 0.3:
        names = [
            "terms",
            "kind",
            "picture",
            "words",
            "weight",
            "strokes",
            "plan",
            "ready",
            "count",
            "only",
            chance.choice(NASTY),
        ]
        return {chance.choice(names): nonsense(chance, depth + 1) for _ in range(chance.randint(0, 4))}
    if depth < 3 and chance.random() < 0.2:
        return [nonsense(chance, depth + 1) for _ in range(chance.randint(0, 3))]
    return chance.choice(kinds)


def almost_sensible(chance: random.Random) -> dict[str, Any]:
    """A wish or an order with something wrong in it, or nothing."""
    wish = {"terms": [{"kind": "text", "words": "a ship"}], "strokes": 5, "title": chance.choice(NASTY)}
    order = chance.choice([wish, {"plan": 1, "ready": True}, {"kind": "pause"}, {"picture": "0" * 32, "only": False}])
    return {**order, chance.choice([*order, "effort", "seed", "width"]): nonsense(chance, 2)}


def request(chance: random.Random, paths: dict[str, Any], known: str) -> tuple[str, str, dict[str, str], bytes]:
    """One request: method, path, headers, body."""
    template = chance.choice([*paths, "/static/{name}", "/{name}", "/"])
    path = "/".join(
        part
        if not part.startswith("{")
        else known
        if "identifier" in part and chance.random() < 0.6
        else chance.choice(NASTY)
        for part in template.split("/")
    )
    method = chance.choice(["GET", "POST", "POST", "POST", "PUT", "DELETE", "HEAD", "OPTIONS", "PATCH"])
    written = json.dumps(chance.choice([nonsense, almost_sensible])(chance)).encode()
    return (
        method,
        path,
        {"Content-Type": chance.choice(TYPES[:1] * 6 + TYPES)},
        chance.choice([written, written, chance.choice(BODIES)]),
    )


@pytest.mark.slow
def test_nothing_senseless_does_any_harm(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(Place, "start", lambda self, job, plan: None)
    monkeypatch.setattr(limits.Bucket, "take", lambda self, who: True)
    studio = Studio(tmp_path / "the-shelf")
    visitor: Visitor = studio.visitor()
    known = studio.shelf.begin("Known").id
    paths = {path: None for path in studio.app.openapi()["paths"] if not path.endswith(("/events", "/delete"))}
    chance = random.Random(1)
    for _ in range(COUNT):
        method, path, headers, body = request(chance, paths, known)
        url = path.replace("\x00", "%00").replace("?", "%3F").replace("#", "%23")
        if not url.isprintable():
            continue
        signed = {**headers, "Origin": "http://127.0.0.1:8350", "X-CSRF-Token": visitor.csrf}
        answer = visitor.client.request(method, url, headers=signed, content=body)
        told = answer.text if method != "HEAD" and "image" not in answer.headers.get("content-type", "") else ""
        assert answer.status_code < 500, (method, url, body[:200], told)
        assert str(tmp_path) not in told and "Traceback" not in told, (method, url, told)
    assert "Traceback" not in capsys.readouterr().err
    assert visitor.get("/api/studio").status_code == 200
