import io

import h5py
import numpy as np
import pytest
import torch
from scipy.signal import correlate

from frida_painter.errors import WeightsError
from frida_painter.objectives.weights.catalogue import holistic_edges, state_dict, vgg_trunk
from tiny_weights import NETWORK, Trap, archive

CONVOLUTIONS = (0, 2, 5, 7, 10, 12, 14, 17, 19, 21, 24, 26, 28)


@pytest.mark.parametrize("zipped", [True, False])
def test_a_state_dict_keeps_names_values_and_types(tmp_path, zipped):
    torch.save(NETWORK, tmp_path / "net.pth", _use_new_zipfile_serialization=zipped)
    loaded = state_dict(tmp_path / "net.pth")
    assert all(
        torch.equal(loaded[name], tensor) and loaded[name].dtype == tensor.dtype for name, tensor in NETWORK.items()
    )


def test_tensors_that_share_memory_or_lie_crosswise_become_plain(tmp_path):
    shared = torch.arange(6.0).reshape(2, 3)
    torch.save({"one": shared, "two": shared.t()}, tmp_path / "net.pth")
    loaded = state_dict(tmp_path / "net.pth")
    assert all(tensor.is_contiguous() for tensor in loaded.values())
    assert loaded["one"].data_ptr() != loaded["two"].data_ptr()
    assert torch.equal(loaded["two"], shared.t())


def test_what_is_no_tensor_is_refused_and_never_runs(tmp_path):
    path = tmp_path / "net.pth"
    for hostile in (archive(Trap(tmp_path / "sprung")), archive({"a": Trap(tmp_path / "sprung")}), b"", b"\x80\x02}q."):
        path.write_bytes(hostile)
        with pytest.raises(WeightsError, match="not an archive of nothing but tensors"):
            state_dict(path)
    assert not (tmp_path / "sprung").exists()
    for strange in ([torch.zeros(2)], {"a": 3}, {"a": {"b": torch.zeros(2)}}):
        torch.save(strange, path)
        with pytest.raises(WeightsError, match="holds something that is no tensor"):
            state_dict(path)


def test_of_vgg16_the_convolutions_are_kept(tmp_path):
    trunk = {
        f"features.{layer}.{part}": torch.full((2,), float(layer))
        for layer in CONVOLUTIONS
        for part in ("weight", "bias")
    }
    torch.save(trunk | {"classifier.0.weight": torch.zeros(9)}, tmp_path / "vgg.pth")
    assert vgg_trunk(tmp_path / "vgg.pth").keys() == trunk.keys()
    torch.save({name: tensor for name, tensor in trunk.items() if ".28." not in name}, tmp_path / "vgg.pth")
    with pytest.raises(WeightsError, match="12 convolutions in place of 13"):
        vgg_trunk(tmp_path / "vgg.pth")


def keras_layers() -> list[str]:
    """The layers of HED as Keras writes them, from the shallowest to the deepest, the sides, and the fusion."""
    trunk = [
        f"block{block}/layers/conv2d{suffix}"
        for block, count in enumerate((2, 2, 3, 3, 3), start=1)
        for suffix in ("", "_1", "_2")[:count]
    ]
    return [*trunk, *(f"dsn{side}" for side in range(1, 6)), "fuse"]


def write_hed(path, leave_out=None) -> dict[str, np.ndarray]:
    generator = np.random.default_rng(0)
    kernels = {}
    with h5py.File(path, "w") as file:
        for layer in keras_layers():
            if layer == leave_out:
                continue
            size = 3 if "block" in layer else 1
            kernels[layer] = generator.normal(size=(size, size, 2, 4)).astype(np.float32)
            file[f"{layer}/vars/0"] = kernels[layer]
            file[f"{layer}/vars/1"] = np.arange(4, dtype=np.float32)
    return kernels


def test_the_convolutions_of_hed_do_what_they_did_in_keras(tmp_path):
    kernels = write_hed(tmp_path / "hed.h5")
    tensors = holistic_edges(tmp_path / "hed.h5")
    picture = np.random.default_rng(1).normal(size=(6, 7, 2)).astype(np.float32)  # [h, w, in], as in Keras
    names = [*(f"features.{layer}" for layer in CONVOLUTIONS), "dsn1", "dsn2", "dsn3", "dsn4", "dsn5", "fuse"]
    assert len(tensors) == 2 * len(names)
    for name, layer in zip(names, keras_layers(), strict=True):
        ours = torch.nn.functional.conv2d(
            torch.from_numpy(picture).permute(2, 0, 1)[None], tensors[f"{name}.weight"], tensors[f"{name}.bias"]
        )[0]
        for output in range(4):
            theirs = correlate(picture, kernels[layer][..., output], mode="valid")[..., 0] + output
            np.testing.assert_allclose(ours[output], theirs, atol=1e-4)


def test_what_is_no_hed_is_told(tmp_path):
    write_hed(tmp_path / "hed.h5", leave_out="dsn3")
    with pytest.raises(WeightsError, match="a layer is missing or damaged"):
        holistic_edges(tmp_path / "hed.h5")
    (tmp_path / "hed.h5").write_bytes(b"no archive")
    with pytest.raises(WeightsError, match="not HED in Keras's layout"):
        holistic_edges(tmp_path / "hed.h5")
    content = io.BytesIO()
    torch.save(NETWORK, content)
    (tmp_path / "hed.h5").write_bytes(content.getvalue())
    with pytest.raises(WeightsError, match="not HED"):
        holistic_edges(tmp_path / "hed.h5")
