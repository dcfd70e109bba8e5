"""A device that is not there: its tensors are computed on the CPU, and refused wherever a real device's would be.

Operations on tensors of two devices, and NumPy's on a device's memory, are what fails on a machine with a GPU and
nowhere else. Here they fail too. The device is called "meta", whose name every build of PyTorch knows.

Where the CPU would wait for a real device, and that would stand still meanwhile, `waits` notes it.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import torch
from torch import Tensor
from torch.utils._python_dispatch import TorchDispatchMode
from torch.utils._pytree import tree_flatten, tree_map

ELSEWHERE = torch.device("meta")
_aten = torch.ops.aten
_ACROSS = {_aten.copy_.default, _aten._to_copy.default}  # operations whose business are two devices
_INDEXED = {_aten.index.Tensor, _aten.index_put_.default, _aten.index_put.default}  # by indices of either
# How many numbers come of these, or which, only the device knows.
_ANSWERS = {"_local_scalar_dense", "nonzero", "masked_select", "_unique2", "unique_dim", "unique_consecutive", "equal"}
_noted: list[list[str]] = []


class _There(Tensor):
    """A tensor of that device; `held` has its numbers."""

    held: Tensor

    @staticmethod
    def __new__(cls, held: Tensor) -> "_There":
        made = Tensor._make_wrapper_subclass(
            cls,
            held.shape,
            strides=held.stride(),
            storage_offset=held.storage_offset(),
            dtype=held.dtype,
            device=ELSEWHERE,
        )
        made.held = held
        return made

    def tolist(self) -> Any:
        """As of a real device, whose numbers are fetched; subclasses have no `tolist` of their own."""
        _note("tolist")
        return self.held.tolist()

    def new_tensor(self, data: Any, **how: Any) -> Tensor:
        """As of a real device; on "meta" PyTorch would leave the numbers out."""
        _note("new_tensor")
        return _There(self.held.new_tensor(data, **how))

    def __getitem__(self, index: Any) -> Any:
        """As of a real device; PyTorch makes of a list an index on the tensor's own device, without its numbers."""
        return super().__getitem__(_of_tensors(index))

    def __setitem__(self, index: Any, value: Any) -> None:
        super().__setitem__(_of_tensors(index), value)

    @classmethod
    def __torch_dispatch__(cls, func: Any, types: Any, args: Any = (), kwargs: Any = None) -> Any:
        return _compute(func, args, kwargs or {})


def _of_tensors(index: Any) -> Any:
    """An index in which what was a list is a tensor."""
    if isinstance(index, tuple):
        return tuple(_of_tensors(part) for part in index)
    return torch.tensor(index, dtype=torch.long) if isinstance(index, list) else index


class _Mode(TorchDispatchMode):
    def __torch_dispatch__(self, func: Any, types: Any, args: Any = (), kwargs: Any = None) -> Any:
        return _compute(func, args, kwargs or {})


@contextmanager
def elsewhere() -> Iterator[torch.device]:
    """The device, as long as it is pretended."""
    with _Mode():
        yield ELSEWHERE


@contextmanager
def waits() -> Iterator[list[str]]:
    """The operations, by name, for which the CPU would wait."""
    noted: list[str] = []
    _noted.append(noted)
    try:
        yield noted
    finally:
        _noted.remove(noted)


def _note(operation: str) -> None:
    for noted in _noted:
        noted.append(operation)


def _waits(func: Any, given: list[Tensor], there: bool, args: Any, kwargs: dict[str, Any]) -> bool:
    """Whether the CPU waits for the device there."""
    if func in _ACROSS:
        lands = _to(func, args, kwargs, there)
        leaves = isinstance(args[1 if func is _aten.copy_.default else 0], _There)
        kept = kwargs.get("non_blocking", len(args) > 2 and args[2])
        return (leaves and not lands) or (lands and not leaves and not kept)
    if not there:
        return False
    masks = func in _INDEXED and any(one.dtype in (torch.bool, torch.uint8) for one in given[1:])
    sends = func in _INDEXED and any(not isinstance(one, _There) for one in given[1:])
    return masks or sends or func._schema.name.partition("::")[2] in _ANSWERS


def _to(func: Any, args: Any, kwargs: dict[str, Any], there: bool) -> bool:
    """Whether what comes of an operation lies on the device."""
    if func is _aten.copy_.default:
        return isinstance(args[0], _There)
    wanted = kwargs.get("device")
    return there if wanted is None else torch.device(wanted) == ELSEWHERE


def _compute(func: Any, args: Any, kwargs: dict[str, Any]) -> Any:
    given = [one for one in tree_flatten((args, kwargs))[0] if isinstance(one, Tensor)]
    there = {id(one.held): one for one in given if isinstance(one, _There)}
    here = [one for one in given if not isinstance(one, _There)]
    assert not any(one.device == ELSEWHERE for one in here), f"{func}: PyTorch made a tensor without its numbers"
    if there and func not in _ACROSS:
        # A number is taken along to any device; and so are indices.
        foreign = [one for one in here if one.dim() and not (func in _INDEXED and one is not args[0])]
        if foreign:
            shapes = [tuple(one.shape) for one in foreign]
            raise RuntimeError(f"{func}: expected all tensors on one device, found some of shape {shapes} on the CPU")
    if there and func in _INDEXED and not isinstance(args[0], _There):
        raise RuntimeError(f"{func}: a tensor on the CPU was given indices of another device")
    lands = _to(func, args, kwargs, bool(there))
    if _noted and _waits(func, given, bool(there), args, kwargs):
        _note(str(func))
    if kwargs.get("device") is not None:
        kwargs = {**kwargs, "device": torch.device("cpu")}
    plain = tree_map(lambda one: one.held if isinstance(one, _There) else one, (args, kwargs))
    found = func(*plain[0], **plain[1])

    def placed(one: Any) -> Any:
        if not isinstance(one, Tensor) or not lands:
            return one
        return there.get(id(one)) if id(one) in there else _There(one)

    return tree_map(placed, found)
