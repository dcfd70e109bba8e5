import pickle
from pathlib import Path

import pytest
import torch

from frida_painter.errors import StorageError
from frida_painter.system import tensor_file


def test_tensors_come_back_as_they_were(tmp_path: Path) -> None:
    tensors = {"a": torch.rand(3, 4).T, "b": torch.arange(5), "empty": torch.zeros(0, 2)}
    sha256 = tensor_file.write_tensors(tmp_path / "t.safetensors", tensors, {"brush": "fine"})
    found, metadata = tensor_file.read_tensors(tmp_path / "t.safetensors", "tensors", sha256=sha256)
    assert metadata == {"brush": "fine"} and found.keys() == tensors.keys()
    assert all(torch.equal(found[name], tensors[name]) for name in tensors)
    with pytest.raises(StorageError, match="sha256 differs"):
        tensor_file.read_tensors(tmp_path / "t.safetensors", "tensors", sha256="0" * 64)


def test_tensors_that_are_damaged_pickled_or_not_finite_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "t.safetensors"
    tensor_file.write_tensors(path, {"a": torch.ones(100)})
    path.write_bytes(path.read_bytes()[:-4])
    with pytest.raises(StorageError, match="damaged or not safetensors"):
        tensor_file.read_tensors(path, "tensors")
    path.write_bytes(pickle.dumps({"a": 1}))
    with pytest.raises(StorageError, match="damaged or not safetensors"):
        tensor_file.read_tensors(path, "tensors")
    tensor_file.write_tensors(path, {"a": torch.tensor([1.0, float("nan")])})
    with pytest.raises(StorageError, match="not finite in 'a'"):
        tensor_file.read_tensors(path, "tensors")
