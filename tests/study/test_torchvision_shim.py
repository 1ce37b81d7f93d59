"""torchvision's stand-in: what it leaves, and that it blurs as scipy does."""

from __future__ import annotations

import importlib.util
import sys

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

torch = pytest.importorskip("torch", reason="NO INDEPENDENT OBSERVER: torch is not installed")


@pytest.mark.parametrize(("kernel", "sigma"), [(13, 3.0), (5, 0.8)])
def test_the_blur_is_a_gaussian_cut_off_and_mirrored(kernel: int, sigma: float) -> None:
    from limen.study.torchvision_shim import GaussianBlur

    image = np.random.default_rng(0).random((3, 1, 40, 31)).astype(np.float32)
    blurred = GaussianBlur(kernel, sigma).forward(torch.from_numpy(image)).numpy()
    for plane, expected in zip(blurred[:, 0], image[:, 0], strict=True):
        plain = gaussian_filter(expected.astype(float), sigma, mode="mirror", radius=kernel // 2)
        assert np.abs(plane - plain).max() < 1e-5


def test_the_blur_is_torchvisions() -> None:
    transforms = pytest.importorskip("torchvision.transforms")
    from limen.study.torchvision_shim import GaussianBlur

    image = torch.rand(2, 1, 40, 31)
    assert torch.allclose(
        GaussianBlur(13, 3.0).forward(image), transforms.GaussianBlur(13, 3.0).forward(image), atol=1e-6
    )


@pytest.mark.skipif(importlib.util.find_spec("torchvision") is not None, reason="torchvision is installed here")
def test_the_stand_in_is_there_only_while_it_is_needed() -> None:
    from limen.study.torchvision_shim import GaussianBlur, torchvision_stood_in_for

    def use() -> None:
        with torchvision_stood_in_for():
            from torchvision.ops import MLP
            from torchvision.transforms import GaussianBlur as Found

            assert Found is GaussianBlur
            MLP(3, [4])

    with pytest.raises(NotImplementedError, match="torchvision"):
        use()
    assert not [name for name in sys.modules if name.split(".")[0] == "torchvision"]
