import datetime
import ipaddress
import json
import ssl
from contextlib import closing
from http.client import HTTPSConnection
from pathlib import Path

import pytest
from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.x509.oid import NameOID

from frida_painter.errors import ConfigError
from frida_painter_studio.network import Certificate
from served import end_listener, open_studio


def make(folder: Path, name: str) -> Certificate:
    """A certificate that vouches for itself, with its key."""
    key = ec.generate_private_key(ec.SECP256R1())
    who = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, "the studio")])
    now = datetime.datetime.now(datetime.UTC)
    address = x509.SubjectAlternativeName([x509.IPAddress(ipaddress.ip_address("127.0.0.1"))])
    builder = x509.CertificateBuilder().subject_name(who).issuer_name(who).public_key(key.public_key())
    builder = builder.serial_number(1).not_valid_before(now - datetime.timedelta(hours=1))
    signed = builder.not_valid_after(now + datetime.timedelta(days=1)).add_extension(address, False)
    made = signed.sign(key, hashes.SHA256())
    found = Certificate(folder / f"{name}.pem", folder / f"{name}.key")
    found.certificate.write_bytes(made.public_bytes(serialization.Encoding.PEM))
    kind = serialization.PrivateFormat.PKCS8
    found.key.write_bytes(key.private_bytes(serialization.Encoding.PEM, kind, serialization.NoEncryption()))
    return found


def test_both_ports_are_encrypted_with_it(tmp_path: Path) -> None:
    made = make(tmp_path, "studio")
    words = ("--certificate", str(made.certificate), "--key", str(made.key))
    served = open_studio(tmp_path / "paintings", words=words)
    trust = ssl.create_default_context(cafile=str(made.certificate))
    try:
        bearer = {"Authorization": f"Bearer {served.tokens['operate']}"}
        with closing(HTTPSConnection(served.host, served.port, timeout=30, context=trust)) as page:
            page.request("GET", "/api/studio", headers=bearer)
            answer = page.getresponse()
            way = json.loads(answer.read())["stop"]
            allowed = answer.headers["content-security-policy"]
        assert f"connect-src 'self' https://{served.host}:{way['port']} " in allowed
        with closing(HTTPSConnection(served.host, way["port"], timeout=30, context=trust)) as stop:
            stop.request("POST", "/stop", way["secret"], {"Origin": f"https://{served.host}:{served.port}"})
            assert json.loads(stop.getresponse().read()) == {"stopped": 0, "heard": 0}
        with closing(HTTPSConnection(served.host, served.port, timeout=30, context=trust)) as page:
            page.request("GET", f"/?token={served.tokens['watch']}")
            assert "secure" in page.getresponse().headers["set-cookie"].lower()
    finally:
        served.kill()
        end_listener(served.folder)


def test_files_that_do_not_fit_are_refused(tmp_path: Path) -> None:
    first, second = make(tmp_path, "first"), make(tmp_path, "second")
    assert Certificate.from_files(None, None) is None
    assert Certificate.from_files(first.certificate, first.key) is not None
    for certificate, key in ((first.certificate, second.key), (first.key, first.certificate)):
        with pytest.raises(ConfigError, match="its own key"):
            Certificate.from_files(certificate, key)
