"""Tensor files: safetensors, written atomically, and read without running code from the file."""

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path

import torch
from safetensors import SafetensorError
from safetensors.torch import load, save

from frida_painter.errors import FridaError, StorageError
from frida_painter.system import storage

MAX_TENSOR_BYTES = 2 * 2**30
_MAX_HEADER = 100_000_000  # bytes, the limit of safetensors itself


def write_tensors(path: Path, tensors: Mapping[str, torch.Tensor], metadata: Mapping[str, str] | None = None) -> str:
    """Writes tensors as safetensors atomically and returns the sha256 of the file. Raises StorageError."""
    content = save(
        {name: tensor.detach().cpu().contiguous() for name, tensor in tensors.items()},
        metadata=dict(metadata) if metadata else None,
    )
    storage.write_bytes(path, content)
    return hashlib.sha256(content).hexdigest()


def read_tensors(
    path: Path, what: str, error: type[FridaError] = StorageError, sha256: str | None = None
) -> tuple[dict[str, torch.Tensor], dict[str, str]]:
    """Returns the tensors and the metadata of a safetensors file.

    what: name of the file in messages
    sha256: expected hash, checked on the bytes that are parsed; None for no check
    Raises `error` if the file is missing, damaged, not safetensors (a pickle is never run), holds numbers that
    are not finite, or has another hash.
    """
    with storage.open_checked(path, what, MAX_TENSOR_BYTES, error) as file:
        if sha256 is None:  # an unknown file is checked before it fills the memory
            _require_header(file.read(8), path, what, error)
            file.seek(0)
        content = file.read(MAX_TENSOR_BYTES + 1)
    if sha256 is not None and hashlib.sha256(content).hexdigest() != sha256:
        raise error(f"{path} is not the file that belongs to {what} (its sha256 differs); take an unchanged copy.")
    try:
        tensors = load(content)
        header = json.loads(content[8 : 8 + int.from_bytes(content[:8], "little")])
    except (SafetensorError, ValueError, RecursionError, KeyError) as cause:
        raise error(
            f"{path} is not {what}: it is damaged or not safetensors ({cause}); take an undamaged copy."
        ) from cause
    for name, tensor in tensors.items():
        if tensor.is_floating_point() and not bool(torch.isfinite(tensor).all()):
            raise error(f"{path} holds numbers that are not finite in {name!r}; take an undamaged copy.")
    return tensors, dict(header.get("__metadata__", {}))


def _require_header(start: bytes, path: Path, what: str, error: type[FridaError]) -> None:
    if not (len(start) == 8 and 2 <= int.from_bytes(start, "little") <= _MAX_HEADER):
        raise error(f"{path} is not {what}: it is damaged or not safetensors; take an undamaged copy.")
