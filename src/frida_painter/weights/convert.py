"""From published files to safetensors: state dicts of PyTorch without running what they hold, HDF5 by h5py.

A file comes here only after its hash has matched. Tensors keep the names that PyTorch's own
networks give them, so that the trunk of HED and that of VGG16 are loaded by the same code.
"""

import warnings
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from frida_painter import extras
from frida_painter.errors import WeightsError

# Positions of the convolutions of VGG16's five blocks among its layers, as torchvision counts them.
_VGG_BLOCKS = ((0, 2), (5, 7), (10, 12, 14), (17, 19, 21), (24, 26, 28))
_HED_SIDES = ("dsn1", "dsn2", "dsn3", "dsn4", "dsn5", "fuse")
HDF5 = ("sketch", "h5py")
"""The extra and the package that read HDF5."""


def state_dict(path: Path) -> dict[str, Tensor]:
    """All tensors of a state dict that `torch.save` wrote. Raises WeightsError where it holds anything else."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # old archives speak of storages that PyTorch deprecates
            loaded = torch.load(path, map_location="cpu", weights_only=True)
    except OSError as cause:
        raise WeightsError(f"{path} cannot be read ({cause.strerror}).") from cause
    except Exception as cause:  # what is no archive of tensors fails in whatever way its bytes happen to
        raise WeightsError(f"{path.name} is not an archive of nothing but tensors, so it was not opened.") from cause
    if not isinstance(loaded, dict) or not all(isinstance(tensor, Tensor) for tensor in loaded.values()):
        raise WeightsError(f"{path.name} is not a state dict: it holds something that is no tensor.")
    return {str(name): tensor.detach().clone(memory_format=torch.contiguous_format) for name, tensor in loaded.items()}


def vgg_trunk(path: Path) -> dict[str, Tensor]:
    """The 13 convolutions of VGG16, `features.N.weight` and `.bias`; the classifier, nine tenths of it, is left out."""
    trunk = {name: tensor for name, tensor in state_dict(path).items() if name.startswith("features.")}
    if len(trunk) != 26:
        raise WeightsError(f"{path.name} is not VGG16: it has {len(trunk) // 2} convolutions in place of 13.")
    return trunk


def holistic_edges(path: Path) -> dict[str, Tensor]:
    """HED from Keras's HDF5 layout: the trunk as `features.N`, the side outputs `dsn1` ... `dsn5`, and `fuse`.

    Kernels turn from [height, width, in, out] to PyTorch's [out, in, height, width]. Xie & Tu,
    "Holistically-Nested Edge Detection", ICCV 2015. Raises WeightsError where a layer is missing, or
    h5py is not installed.
    """
    extras.require(*HDF5, "Reading the edge detector HED", WeightsError)
    import h5py

    layers = {
        f"features.{position}": f"block{block}/layers/conv2d{f'_{index}' if index else ''}"
        for block, positions in enumerate(_VGG_BLOCKS, start=1)
        for index, position in enumerate(positions)
    } | {side: side for side in _HED_SIDES}

    tensors = {}
    try:
        with h5py.File(path, "r") as file:
            for name, layer in layers.items():
                kernel = np.asarray(file[f"{layer}/vars/0"], dtype=np.float32)  # [kh, kw, in, out]
                tensors[f"{name}.weight"] = torch.from_numpy(kernel.transpose(3, 2, 0, 1).copy())
                tensors[f"{name}.bias"] = torch.from_numpy(np.asarray(file[f"{layer}/vars/1"], dtype=np.float32))
    except (OSError, KeyError, TypeError, ValueError) as cause:
        raise WeightsError(f"{path.name} is not HED in Keras's layout: a layer is missing or damaged.") from cause
    return tensors
