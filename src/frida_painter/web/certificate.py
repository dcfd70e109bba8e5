"""The certificate of a studio that is reached over a network."""

import ssl
from dataclasses import dataclass
from pathlib import Path
from typing import Self

from frida_painter.errors import ConfigError


@dataclass(frozen=True)
class Certificate:
    """A certificate (with the chain above it) and its private key, both PEM files; the key has no passphrase."""

    certificate: Path
    key: Path

    @classmethod
    def given(cls, certificate: Path | None, key: Path | None) -> Self | None:
        """As on a command line, checked; None where neither was given. Raises ConfigError."""
        if certificate is None and key is None:
            return None
        if certificate is None or key is None:
            raise ConfigError("--certificate and --key belong together; give both, or neither.")
        for path in (certificate, key):
            if not path.is_file():
                raise ConfigError(f"{path} is no file; --certificate and --key are PEM files.")
        found = cls(certificate.absolute(), key.absolute())
        found.context()
        return found

    def context(self) -> ssl.SSLContext:
        """How connections are encrypted with it. Raises ConfigError where the files do not fit."""
        context = ssl.create_default_context(ssl.Purpose.CLIENT_AUTH)
        try:
            context.load_cert_chain(self.certificate, self.key, password=lambda: b"")
        except (OSError, ssl.SSLError) as error:
            raise ConfigError(
                f"--certificate {self.certificate} and --key {self.key} cannot be used "
                f"({getattr(error, 'reason', None) or error.strerror or error}); "
                "give a PEM certificate and its own key, without a passphrase."
            ) from error
        return context
