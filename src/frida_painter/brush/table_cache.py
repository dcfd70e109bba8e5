"""Tables of stroke models that were made before, kept in the system's folder for caches.

Tabulating a network takes some seconds of computing, which every command would begin with; reading a table
takes milliseconds. A file is named after everything that its table follows from, so that it is never out of
date; one that is damaged is made anew. Our own models follow from their weights. Of any other nothing is known
but what it gives, so it is sampled every time, and only the fit of the table is saved.
"""

import contextlib
import hashlib
from dataclasses import astuple
from pathlib import Path

import platformdirs
import torch
from torch import Tensor, nn

from frida_painter import tensor_file
from frida_painter.brush.stroke_model import StrokeModel
from frida_painter.brush.table import StrokeTable, TableDetail, sample
from frida_painter.errors import StorageError

# To be raised whenever a table, or what a stroke model makes of its weights, is computed otherwise.
VERSION = 3
# The tables of this many models are kept, about 1.5 MB each.
_MOST_KEPT = 16


def cached_table(model: StrokeModel, detail: TableDetail | None = None, folder: Path | None = None) -> StrokeTable:
    """The table of a model (float32, CPU): read where it was made before, else made, and written.

    folder: of the tables (default: the one that the system gives to caches). Where it cannot be written
    to, tables are made every time.
    """
    detail = detail or TableDetail()
    folder = folder or platformdirs.user_cache_path("frida-painter", appauthor=False) / "tables"
    samples = None if isinstance(model, nn.Module) and _is_ours(model) else sample(model, detail, torch.zeros(()))
    path = folder / f"{_identity(model, detail, samples)}.safetensors"
    # A table that is missing, damaged or not one is made anew; so is one of other shapes than it should have.
    with contextlib.suppress(StorageError, KeyError, ValueError):
        return StrokeTable.restored(model, detail, tensor_file.read_tensors(path, "a table of a stroke model")[0])
    if samples is None:
        samples = sample(model, detail, torch.zeros(()))
    table = StrokeTable.fitted(model, detail, samples)
    with contextlib.suppress(StorageError, OSError):
        tensor_file.write_tensors(path, table.kept())
        for old in sorted(folder.glob("*.safetensors"), key=lambda one: one.stat().st_mtime)[:-_MOST_KEPT]:
            old.unlink(missing_ok=True)
    return table


def _is_ours(model: nn.Module) -> bool:
    """Whether what the model computes changes with its weights and `VERSION` only, and with no edit of its code."""
    return type(model).__module__.startswith("frida_painter.")


def _identity(model: StrokeModel, detail: TableDetail, samples: Tensor | None) -> str:
    """Differs between models and details of different tables; by the samples, or without any by the weights."""
    about = (VERSION, type(model).__name__, torch.__version__, model.brush, astuple(model.frame), astuple(model.limits))
    told = hashlib.sha256(repr((*about, astuple(detail))).encode())
    weights = model.state_dict() if samples is None and isinstance(model, nn.Module) else {"samples": samples}
    for name, tensor in sorted(weights.items()):
        told.update(f"{name} {tensor.dtype} {tuple(tensor.shape)}".encode())
        told.update(tensor.detach().cpu().contiguous().numpy().tobytes())
    return told.hexdigest()[:32]
