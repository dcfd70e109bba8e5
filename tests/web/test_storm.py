"""Requests of all kinds, most of them senseless: none is answered with an accident, and none learns a path."""

import importlib.util
import random
from pathlib import Path
from types import ModuleType

import pytest

from frida_painter.web import limits
from frida_painter.web.workers import Place
from studios import Studio, Visitor, order

COUNT = 800


@pytest.fixture(scope="module")
def storm() -> ModuleType:
    """benchmarks/storm.py, which throws ten thousand and more at a studio that is really served."""
    path = Path(__file__).parents[2] / "benchmarks" / "storm.py"
    specification = importlib.util.spec_from_file_location("storm", path)
    module = importlib.util.module_from_spec(specification)
    specification.loader.exec_module(module)
    return module


@pytest.mark.slow
def test_nothing_senseless_does_any_harm(
    storm: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(Place, "start", lambda self, job, plan: None)
    monkeypatch.setattr(limits.Bucket, "take", lambda self, who: True)
    studio = Studio(tmp_path / "the-shelf")
    visitor: Visitor = studio.visitor()
    known = studio.shelf.begin("Known").id
    paths = storm.routes(tmp_path / "another-shelf")
    chance = random.Random(1)
    for _ in range(COUNT):
        method, path, headers, body = storm.request(chance, paths, known)
        url = path.replace("\x00", "%00").replace("?", "%3F").replace("#", "%23")
        if not url.isprintable():
            continue
        signed = {**headers, "Origin": "http://127.0.0.1:8350", "X-CSRF-Token": visitor.csrf, **order()}
        answer = visitor.client.request(method, url, headers=signed, content=body)
        told = answer.text if method != "HEAD" and "image" not in answer.headers.get("content-type", "") else ""
        assert answer.status_code < 500, (method, url, body[:200], told)
        assert str(tmp_path) not in told and "Traceback" not in told, (method, url, told)
    assert "Traceback" not in capsys.readouterr().err
    assert visitor.get("/api/studio").status_code == 200
