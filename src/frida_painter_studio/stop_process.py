"""Keeper of the listener for stops beside a studio: it starts the listener, or uses a running one."""

import asyncio
import contextlib
import json
import socket
import subprocess
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from frida_painter import python_process, storage
from frida_painter.errors import ConfigError, StorageError
from frida_painter_studio import stop_listener
from frida_painter_studio.commands import Role
from frida_painter_studio.network import Certificate, WebAppLock
from frida_painter_studio.stop import END, StopKey, call, listen_locally

_FILE = ".stop.json"
_LOCK = ".stop-lock"
_BETWEEN_LOOKS = 1.0
_ENDING = 3.0  # seconds


@dataclass
class StopProcess:
    """Listener for stops of the studio in `root`.

    listen: returns a listening socket on a port, 0 for a free one; raises ConfigError.
    names: host names of this machine in browsers.
    wanted: preferred port.
    certificate: None without encryption.
    port: port of the started listener.
    """

    root: Path
    listen: Callable[[int], socket.socket]
    names: frozenset[str]
    wanted: int
    certificate: Certificate | None = None
    port: int = field(default=0, init=False)
    _stop_key: StopKey | None = field(default=None, init=False)
    _process: subprocess.Popen[bytes] | None = field(default=None, init=False)

    def start(self) -> None:
        """Starts a listener, unless a running one has the same settings. Raises ConfigError, StorageError."""
        lock = WebAppLock(self.root, _LOCK)
        try:
            before = self._before()
            if not lock.take_alone():
                if before == self._config | {"port": before.get("port", 0)} and before["port"]:
                    self.port = int(before["port"])
                    return
                self._end_other(lock)
            self._launch(lock, self.port or int(before.get("port", 0)) or self.wanted)
        except OSError as error:
            raise StorageError(f"The listener for stops cannot be started ({error.strerror}).") from error
        finally:
            lock.release()

    def secret(self, role: Role) -> str:
        """Returns the secret for stops of a page of that role. Raises StorageError."""
        if self._stop_key is None:
            self._stop_key = StopKey.of(self.root)
        return self._stop_key.secret(role)

    async def keep(self) -> None:
        """Restarts the listener whenever it has ended."""
        while True:
            await asyncio.sleep(_BETWEEN_LOOKS)
            if self._process is not None:
                self._process.poll()
            with contextlib.suppress(ConfigError, StorageError):
                await asyncio.to_thread(self.start)

    @property
    def _config(self) -> dict[str, object]:
        files = self.certificate and [str(self.certificate.certificate), str(self.certificate.key)]
        return {"names": sorted(self.names), "certificate": files}

    def _before(self) -> dict[str, Any]:
        """Returns the settings of the last listener; empty if there was none."""
        try:
            return storage.read_json(self.root / _FILE, "where stops are listened to")
        except StorageError:
            return {}

    def _end_other(self, lock: WebAppLock) -> None:
        with contextlib.suppress(OSError), call(self.root) as line:
            line.sendall(f"{END}\n".encode())
        until = time.monotonic() + _ENDING
        while not lock.take_alone():
            if time.monotonic() > until:
                raise StorageError("Another studio in this folder listens for stops, and does not give way; close it.")
            time.sleep(0.02)

    def _launch(self, lock: WebAppLock, wanted: int) -> None:
        try:
            port = self.listen(wanted)
        except ConfigError:
            port = self.listen(0)
        with port, listen_locally(self.root) as line:
            self.port = port.getsockname()[1]
            storage.write_json(self.root / _FILE, {**self._config, "port": self.port})
            inherited = [port.fileno(), line.fileno(), lock.fileno()]
            program = "-m", stop_listener.__name__, self.root, *inherited, json.dumps(self._config)
            with (self.root / "stop.log").open("ab") as log:
                self._process = python_process.start(
                    *program, pass_fds=inherited, start_new_session=True, stdout=log, stderr=log
                )
