"""The two things that pycvvdp asks of torchvision, for machines without it.

torchvision is built against one torch, mostly one with CUDA, of gigabytes. ColorVideoVDP needs a Gaussian blur of it,
and a class that only its learned variants use, which limen does not.
"""

from __future__ import annotations

import contextlib
import importlib.util
import sys
from collections.abc import Iterator
from types import ModuleType
from typing import Any

import torch
from torch.nn.functional import conv2d, pad

__all__ = ["GaussianBlur", "torchvision_stood_in_for"]


class GaussianBlur:
    """Blur (N, C, H, W) with a Gaussian cut off at ``kernel_size`` taps, mirrored at the edges.

    The same as ``torchvision.transforms.GaussianBlur`` with one sigma, an axis at a time.
    """

    def __init__(self, kernel_size: int, sigma: float) -> None:
        at = torch.arange(kernel_size, dtype=torch.float32) - (kernel_size - 1) / 2
        weight = torch.exp(-0.5 * (at / sigma) ** 2)
        self._weight = weight / weight.sum()
        self._margin = kernel_size // 2

    def forward(self, image: torch.Tensor) -> torch.Tensor:
        channels, margin = image.shape[1], self._margin
        weight = self._weight.to(image).expand(channels, 1, -1)
        across = conv2d(pad(image, (margin, margin, 0, 0), "reflect"), weight[:, :, None, :], groups=channels)
        return conv2d(pad(across, (0, 0, margin, margin), "reflect"), weight[:, :, :, None], groups=channels)


class _Mlp:
    def __init__(self, *_given: Any, **_named: Any) -> None:
        raise NotImplementedError("the learned variants of ColorVideoVDP need torchvision")


@contextlib.contextmanager
def torchvision_stood_in_for() -> Iterator[None]:
    """Within, ``import torchvision`` finds these if the true one is not installed; afterwards nothing is left."""
    if importlib.util.find_spec("torchvision") is not None:
        yield
        return
    package, transforms, ops = (ModuleType(f"torchvision{part}") for part in ("", ".transforms", ".ops"))
    transforms.GaussianBlur = GaussianBlur  # type: ignore[attr-defined]
    ops.MLP = _Mlp  # type: ignore[attr-defined]
    package.transforms, package.ops = transforms, ops  # type: ignore[attr-defined]
    ours = {module.__name__: module for module in (package, transforms, ops)}
    sys.modules.update(ours)
    try:
        yield
    finally:
        for name in ours:
            sys.modules.pop(name, None)
