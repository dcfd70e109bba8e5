import asyncio
from pathlib import Path
from typing import Any

import pytest

from frida_painter_studio import network
from frida_painter_studio.network import MAX_BODY, MAX_UPLOAD, Bucket, Limits
from frida_painter_studio.security import Session
from frida_painter_together.commands import Role
from support.studio import Studio


def test_a_bucket_fills_again_as_time_goes_by() -> None:
    now = [0.0]
    bucket = Bucket(rate=2, most=3, clock=lambda: now[0])
    assert [bucket.take("a") for _ in range(4)] == [True, True, True, False]
    assert bucket.take("b"), "everybody has their own"
    now[0] = 0.5
    assert [bucket.take("a") for _ in range(2)] == [True, False]


@pytest.mark.parametrize(("path", "most"), [("/api/paintings", MAX_BODY), ("/api/pictures", MAX_UPLOAD)])
def test_bodies_that_are_too_large_are_refused(tmp_path: Path, path: str, most: int) -> None:
    visitor = Studio(tmp_path).visitor()
    answer = visitor.post(path, content=b"x" * (most + 1))
    assert answer.status_code == 413 and "at most" in answer.json()["sentence"]
    assert visitor.post(path, content=b"x" * most).status_code == 422


def test_haste_is_refused_but_a_stop_never_is(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def scarce(rate: float, most: float) -> Bucket:
        return Bucket(rate, most / 20, clock=lambda: 0.0)  # a busy computer asks so slowly that nothing is haste

    monkeypatch.setattr(network, "Bucket", scarce)
    visitor = Studio(tmp_path).visitor()
    codes = {visitor.get("/api/paintings").status_code for _ in range(35)}
    assert codes == {200, 429}
    assert all(visitor.post("/api/stop").status_code == 200 for _ in range(20))


def test_a_body_that_never_ends_is_not_waited_for(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(network, "_PATIENCE", 0.05)
    sent: list[dict[str, Any]] = []

    async def never(scope: Any, receive: Any, send: Any) -> None:
        raise AssertionError("handed on")

    async def dripping() -> dict[str, Any]:
        await asyncio.sleep(0.01)
        return {"type": "http.request", "body": b"x", "more_body": True}

    async def send(message: Any) -> None:
        sent.append(message)

    scope = {"type": "http", "path": "/api/pictures", "state": {"session": Session("a", Role.operate, "")}}
    asyncio.run(Limits(never, "/api/pictures")(scope, dripping, send))
    assert sent[0]["status"] == 408
