"""Devices: compiled loops, transfers to a GPU, constants on each device, half precision; settings of the process."""

import ctypes
import sys
from contextlib import AbstractContextManager, nullcontext
from typing import Any

import torch
from numpy.typing import NDArray
from torch import Tensor

_COMPUTES_BFLOAT16 = (8, 0)  # compute capability, of Ampere and later


def compiles_for(tensor: Tensor) -> bool:
    """Returns True if compiled loops can use the tensor, because it is on the CPU; otherwise PyTorch computes."""
    return tensor.device.type == "cpu"


def array(tensor: Tensor) -> NDArray[Any]:
    """Returns the values of a CPU tensor without gradient; shares its memory if it is contiguous."""
    bare = tensor.detach() if tensor.requires_grad else tensor  # detach makes a new tensor at each call
    return (bare if bare.is_contiguous() else bare.contiguous()).numpy()


def send_to_device(tensor: Tensor, device: torch.device) -> Tensor:
    """Returns a CPU tensor on another device. A transfer to a GPU may still run when this returns."""
    if device.type == "cuda" and tensor.device.type == "cpu":
        tensor = tensor.pin_memory()
    return tensor.to(device, non_blocking=True)


class Constant:
    """A constant tensor, cached for each device and precision in which it was requested."""

    def __init__(self, tensor: Tensor) -> None:
        self._first = tensor
        self._held: dict[tuple[torch.device, torch.dtype], Tensor] = {}

    def like(self, other: Tensor) -> Tensor:
        """Returns the tensor on the device and in the precision of `other`."""
        key = other.device, other.dtype
        if key not in self._held:
            self._held[key] = self._first.to(other)
        return self._held[key]


def half_precision(device: torch.device) -> AbstractContextManager[Any]:
    """Returns a context in which networks compute in bfloat16, on GPUs that support it; else it changes nothing.

    bfloat16 has the range of float32, so small gradients survive. float16 would lose them.
    """
    if device.type == "cuda" and torch.cuda.get_device_capability(device) >= _COMPUTES_BFLOAT16:
        return torch.autocast("cuda", dtype=torch.bfloat16)
    return nullcontext()


_KEPT, _LARGEST = 512 * 2**20, 32 * 2**20  # bytes: memory to keep, largest block to keep (mallopt's limit)
_M_TRIM_THRESHOLD, _M_MMAP_THRESHOLD, _M_ARENA_MAX = -1, -3, -8  # malloc.h


def prepare_process() -> None:
    """Sets this process to one thread and lets it keep up to 512 MiB of freed memory.

    The tensors are small, and torch's idle threads spin: on two cores, planning with torch's default took twice
    the time. Each iteration of the planner frees and takes blocks of some MB. glibc may return them to the
    system each time, which costs about 2,000 page faults. C libraries without mallopt stay unchanged. All
    threads share one arena, because each arena would keep as much memory for itself.
    """
    torch.set_num_threads(1)
    if sys.platform == "linux" and hasattr(library := ctypes.CDLL(None), "mallopt"):  # musl has none
        library.mallopt(_M_MMAP_THRESHOLD, _LARGEST)
        library.mallopt(_M_TRIM_THRESHOLD, _KEPT)
        library.mallopt(_M_ARENA_MAX, 1)
