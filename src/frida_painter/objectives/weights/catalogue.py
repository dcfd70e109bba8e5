"""Catalogue of pretrained weights, which catalogue.toml lists; and how their published files are read."""

import tomllib
import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np
import torch
from pydantic import TypeAdapter
from torch import Tensor

from frida_painter import registry
from frida_painter.errors import WeightsError

NETWORK, PICTURES = "model.safetensors", "pictures.zip"
"""Names of converted files in the cache: the tensors of a network, and a library of pictures."""
_NEEDED_BY_WORDS = ("minilm", "openclipart", "flashcards", "fluent")  # name most things for their size
_VGG_BLOCKS = ((0, 2), (5, 7), (10, 12, 14), (17, 19, 21), (24, 26, 28))  # convolutions, as torchvision numbers them
_HED_SIDES = ("dsn1", "dsn2", "dsn3", "dsn4", "dsn5", "fuse")


@dataclass(frozen=True)
class PublishedFile:
    """File as it was published.

    path: path below the source's folder
    size: bytes
    sha256: hash; of a file that a hub lists without one, git's own hash (40 digits)
    read: name of the function in READERS that reads its tensors; "" if the file is kept as it is, or repacked
    """

    path: str
    size: int
    sha256: str
    read: str = ""

    @property
    def name(self) -> str:
        """Name of the file."""
        return PurePosixPath(self.path).name

    def in_folder(self, scratch: Path) -> Path:
        """Returns the path of the download, named by its hash too, so that parts of two versions do not mix."""
        return scratch / f"{self.sha256}-{self.path.replace('/', '-')}"


@dataclass(frozen=True)
class NamedWeights:
    """Pretrained weights with a name in `frida-painter models`; catalogue.toml explains the fields."""

    name: str
    purpose: str
    licence: str
    credit: str
    sources: tuple[str, ...]
    size: int
    files: tuple[PublishedFile, ...] = ()
    needs: tuple[str, ...] = ()
    folder: str = ""
    listed: str = ""
    pictures: dict[str, Any] = field(default_factory=dict, hash=False)

    @property
    def pins(self) -> list[str]:
        """Hashes that decide which files these are: of the published files, or the revision of a hub."""
        return [self.sources[0].rpartition("@")[2]] if self.listed else [file.sha256 for file in self.files]

    def find_name(self, file: PublishedFile) -> str:
        """Returns the name of a file in the cache."""
        return NETWORK if file.read else PICTURES if self.pictures else file.path

    def is_converted(self, file: PublishedFile) -> bool:
        """Returns True if the cached file differs from the published one."""
        return bool(file.read or self.pictures)


def all_weights() -> tuple[NamedWeights, ...]:
    """Returns all weights; of picture libraries, those with the better pictures first."""
    entries = tomllib.loads(Path(__file__).with_suffix(".toml").read_text("utf-8"))
    return tuple(TypeAdapter(NamedWeights).validate_python({"name": name, **entry}) for name, entry in entries.items())


def words() -> tuple[NamedWeights, ...]:
    """Returns the weights for painting from words except CLIP."""
    return tuple(find_weights(name) for name in _NEEDED_BY_WORDS)


def find_weights(name: str) -> NamedWeights:
    """Returns the weights of that name. Raises WeightsError that lists all names."""
    known = {weights.name: weights for weights in all_weights()}
    if name not in known:
        raise WeightsError(f"There are no weights named {name!r}; there are {', '.join(known)}.")
    return known[name]


def state_dict(path: Path) -> dict[str, Tensor]:
    """Returns all tensors of a state dict of `torch.save`. Raises WeightsError if the file holds anything else."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # deprecated storages in old archives
            loaded = torch.load(path, map_location="cpu", weights_only=True)
    except OSError as cause:
        raise WeightsError(f"{path} cannot be read ({cause.strerror}).") from cause
    except Exception as cause:  # other files fail with any error
        raise WeightsError(f"{path.name} is not an archive of nothing but tensors, so it was not opened.") from cause
    if not isinstance(loaded, dict) or not all(isinstance(tensor, Tensor) for tensor in loaded.values()):
        raise WeightsError(f"{path.name} is not a state dict: it holds something that is no tensor.")
    return {str(name): tensor.detach().clone(memory_format=torch.contiguous_format) for name, tensor in loaded.items()}


def vgg_trunk(path: Path) -> dict[str, Tensor]:
    """Returns the 13 convolutions of VGG16, `features.N.weight` and `.bias`, without the classifier (90 % of the file).

    Raises WeightsError if the file is not VGG16.
    """
    trunk = {name: tensor for name, tensor in state_dict(path).items() if name.startswith("features.")}
    if len(trunk) != 26:
        raise WeightsError(f"{path.name} is not VGG16: it has {len(trunk) // 2} convolutions in place of 13.")
    return trunk


def holistic_edges(path: Path) -> dict[str, Tensor]:
    """Returns HED from Keras's HDF5 layout: trunk `features.N`, as of VGG16, and side outputs `dsn1` ... and `fuse`.

    Kernels are transposed from [height, width, in, out] to PyTorch's [out, in, height, width]. Xie & Tu,
    "Holistically-Nested Edge Detection", ICCV 2015. Raises WeightsError if a layer is missing or h5py is not
    installed.
    """
    registry.require("sketch", "h5py", "Reading the edge detector HED", WeightsError)
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
                kernel, bias = (np.asarray(file[f"{layer}/vars/{number}"], dtype=np.float32) for number in (0, 1))
                tensors[f"{name}.weight"] = torch.from_numpy(kernel.transpose(3, 2, 0, 1).copy())
                tensors[f"{name}.bias"] = torch.from_numpy(bias)
    except (OSError, KeyError, TypeError, ValueError) as cause:
        raise WeightsError(f"{path.name} is not HED in Keras's layout: a layer is missing or damaged.") from cause
    return tensors


READERS: Mapping[str, Callable[[Path], dict[str, Tensor]]] = {
    "state_dict": state_dict,
    "vgg_trunk": vgg_trunk,
    "holistic_edges": holistic_edges,
}
"""Functions that read the tensors of a published file, whose hash was checked before; none runs its code."""
