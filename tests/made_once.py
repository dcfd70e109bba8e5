"""What tests make once for each state of the code, and read again in other processes and in later runs."""

import hashlib
import os
import shutil
from functools import cache
from pathlib import Path

import frida_painter

CODE = Path(frida_painter.__file__).parents[1]
TESTS = Path(__file__).parent
KEPT = TESTS.parent / ".pytest_cache" / "made"
MAX_KEPT = 3  # states of the code


@cache
def made_by_this_code() -> Path:
    """The folder of what the present code makes, named by the hash of its files; the oldest states leave."""
    told = hashlib.sha256()
    for path in sorted((*CODE.glob("frida_painter*/**/*.py"), *TESTS.glob("*.py"), *(TESTS / "support").glob("*.py"))):
        told.update(f"{path.name} {path.stat().st_size}\n".encode() + path.read_bytes())
    folder = KEPT / told.hexdigest()[:16]
    folder.mkdir(parents=True, exist_ok=True)
    os.utime(folder)
    states = sorted(KEPT.iterdir(), key=lambda one: one.stat().st_mtime)
    for old in states[:-MAX_KEPT]:
        shutil.rmtree(old, ignore_errors=True)
    return folder
