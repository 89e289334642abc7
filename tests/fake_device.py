"""A device that computes on the CPU but refuses operations that a GPU refuses,
for machines without a GPU.
"""

import weakref
from collections.abc import Callable, Iterator
from typing import Any

import torch
from torch import Tensor
from torch.overrides import TorchFunctionMode

#: The device in place of a GPU: PyTorch has the name, and no other test uses it.
DEVICE = torch.device("meta")
# a GPU takes indices that lie on the CPU
_TAKING_INDICES = {Tensor.__getitem__, Tensor.__setitem__}
_HOST_ONLY = {Tensor.numpy, Tensor.__array__}


class FakeDevice(TorchFunctionMode):
    """Records which tensors are on ``DEVICE``;
    mixing them with CPU tensors or converting them to arrays raises.
    """

    def __init__(self) -> None:
        super().__init__()
        self.there: weakref.WeakValueDictionary[int, Tensor] = weakref.WeakValueDictionary()

    def __torch_function__(
        self,
        func: Callable[..., Any],
        types: Any,
        args: tuple[Any, ...] = (),
        kwargs: dict[str, Any] | None = None,
    ) -> Any:
        kwargs = dict(kwargs or {})
        if func is Tensor.cpu:
            return args[0].detach().clone()
        if func is Tensor.to and DEVICE in args:
            return self.put(args[0].detach().clone())
        wanted = kwargs.pop("device", None)
        tensors = [value for value in _tensors((args, kwargs)) if value.dim()]
        where = {self.lies_there(value) for value in tensors}
        if wanted is not None and torch.device(wanted) == DEVICE:
            where = {True}
        elif func in _TAKING_INDICES:
            where = {self.lies_there(args[0])}
        if where == {True, False}:
            raise RuntimeError(f"{func.__name__}: expected all tensors to be on the same device")
        if True in where and func in _HOST_ONLY:
            raise TypeError(f"{func.__name__}: can't convert a tensor on a GPU to NumPy")
        result = func(*args, **kwargs)
        if True in where:
            for value in _tensors(result):
                self.put(value)
        return result

    def put(self, value: Tensor) -> Tensor:
        self.there[id(value)] = value
        return value

    def lies_there(self, value: Tensor) -> bool:
        return self.there.get(id(value)) is value


def _tensors(value: Any) -> Iterator[Tensor]:
    if isinstance(value, Tensor):
        yield value
    elif isinstance(value, dict):
        yield from _tensors(tuple(value.values()))
    elif isinstance(value, tuple | list):
        for part in value:
            yield from _tensors(part)
