"""The secrets with which pages stop: they outlive sessions and restarts of the studio, and do nothing else."""

import contextlib
import hashlib
import hmac
import os
import secrets
import time
from pathlib import Path
from typing import Self

from frida_painter import storage
from frida_painter.errors import StorageError
from frida_painter.web.roles import Role

_FILE = ".stop-key"
_BYTES = 32
_DAY = 86400
_GOOD_FOR = {Role.watch: _DAY, Role.plan: _DAY, Role.operate: 30 * _DAY}  # seconds


class StopKey:
    """Makes secrets and knows them again. Each names a role and when it ends, and is signed with the studio's key.

    Whoever may look may stop: a watcher's secret ends a day after it was given, an operator's after thirty.
    """

    def __init__(self, key: bytes) -> None:
        self._key = key

    @classmethod
    def of(cls, folder: Path) -> Self:
        """The key of the studio whose paintings are in `folder`, made where there is none. Raises StorageError."""
        path = folder / _FILE
        try:
            if not path.exists():
                _make(path)
            key = storage.read_bytes(path, "the key for stops", _BYTES)
        except OSError as error:
            raise StorageError(f"{path} cannot be kept ({error.strerror}); without it nobody could stop.") from error
        if len(key) != _BYTES:
            raise StorageError(f"{path} is damaged; delete it, and open the studio again.")
        return cls(key)

    def secret(self, role: Role) -> str:
        """A secret for a page of that role."""
        claim = f"{role.name}.{int(time.time()) + _GOOD_FOR[role]}"
        return f"{claim}.{self._sign(claim)}"

    def role(self, secret: str) -> Role | None:
        """Whose secret it is; None where it is none, or is no longer good."""
        claim, _, sign = secret.rpartition(".")
        if not hmac.compare_digest(self._sign(claim).encode(), sign.encode("utf-8", "replace")):
            return None
        name, _, ends = claim.partition(".")
        return Role[name] if time.time() <= int(ends) else None

    def _sign(self, claim: str) -> str:
        return hmac.new(self._key, claim.encode("utf-8", "replace"), hashlib.sha256).hexdigest()


def _make(path: Path) -> None:
    temporary = path.with_name(f"{_FILE}-{secrets.token_hex(8)}")
    file = os.open(temporary, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
    try:
        os.write(file, secrets.token_bytes(_BYTES))
        os.fsync(file)
        with contextlib.suppress(FileExistsError):
            os.link(temporary, path)  # whole, or not at all; who was first is not overwritten
    finally:
        os.close(file)
        temporary.unlink()
