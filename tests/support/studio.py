"""A studio for tests: its application with all middleware, on a store of its own."""

import re
import secrets
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from httpx import Response
from starlette.testclient import TestClient

from frida_painter_studio import web_studio
from frida_painter_studio.picture_choosing import AllowedMakers
from frida_painter_studio.security import Keys, Presence
from frida_painter_studio.server import add_middleware, application
from frida_painter_studio.store import PaintingStore
from frida_painter_studio.studio_folder import PaintingFolder, WorkerLock
from frida_painter_studio.web_app_easel import WebAppEasel
from frida_painter_together.commands import Role

HOST = "127.0.0.1:8350"
ORIGIN = f"http://{HOST}"


@dataclass
class Visitor:
    """A browser that came with the token of a role."""

    client: TestClient
    key: str

    def get(self, path: str, headers: dict[str, str] | None = None, **more: Any) -> Response:
        return self.client.get(path, headers={"X-Page-Key": self.key, **(headers or {})}, **more)

    def post(self, path: str, headers: dict[str, str] | None = None, **more: Any) -> Response:
        signs = {"Origin": ORIGIN, "X-Page-Key": self.key, **order()}
        return self.client.post(path, headers={**signs, **(headers or {})}, **more)


def order() -> dict[str, str]:
    """What every order carries: a number of its own, and when it was given."""
    return {"X-Nonce": secrets.token_hex(16), "X-Given": str(time.time())}


@contextmanager
def locked(folder: PaintingFolder) -> Iterator[WorkerLock]:
    """Somebody is at work in a folder."""
    lock = WorkerLock(folder)
    assert lock.take()
    yield lock
    lock.release()


class Studio:
    """The whole application as it is served, without a socket."""

    def __init__(self, root: Path, easel: WebAppEasel | None = None, makers: AllowedMakers | None = None) -> None:
        self.store = PaintingStore(root)
        self.keys = Keys()
        self.presence = Presence()
        self.easel = easel or WebAppEasel(self.store.job("calibration").path / "calibration.json")
        self.web = web_studio.Studio(self.store, self.easel, self.presence, makers=makers)
        self.app = application(self.web)
        self.served = add_middleware(self.app, self.keys, frozenset({HOST, "localhost:8350"}), "studio-8350")

    def client(self) -> TestClient:
        return TestClient(self.served, base_url=ORIGIN, follow_redirects=False, raise_server_exceptions=False)

    def visitor(self, role: Role = Role.operate) -> Visitor:
        client = self.client()
        entered = client.get("/", params={"token": self.keys.tokens[role]})
        key = re.search(r"#key=([\w-]+)", entered.text)
        assert entered.status_code == 200 and key is not None
        return Visitor(client, key[1])
