"""Tensors for loops that numba compiles: whether they can do the work, and the arrays that they take."""

from importlib.util import find_spec
from typing import Any

from numpy.typing import NDArray
from torch import Tensor


def compiles_for(tensor: Tensor) -> bool:
    """Whether compiled loops can work on it: it is on the CPU, and numba is installed. Elsewhere PyTorch does."""
    return tensor.device.type == "cpu" and find_spec("numba") is not None


def array(tensor: Tensor) -> NDArray[Any]:
    """The numbers of a tensor on the CPU, without its gradient, in its own memory where that has no gaps."""
    bare = tensor.detach() if tensor.requires_grad else tensor  # detach makes a tensor, each time
    return (bare if bare.is_contiguous() else bare.contiguous()).numpy()
