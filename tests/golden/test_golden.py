"""Every kind of content still looks as it did when these pictures were kept, and the same is told of it."""

from __future__ import annotations

import itertools
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from golden.scenes import SCENES, drawn, kept

pytestmark = [pytest.mark.gpu, pytest.mark.drawing]


@pytest.fixture(scope="module")
def contents(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder that contents are made in, once."""
    return tmp_path_factory.mktemp("contents")


@pytest.mark.parametrize("name", SCENES)
def test_the_picture_is_as_it_was(name: str, device: Any, contents: Path) -> None:
    """Within one code on the adapter that the pictures are of; on another, edges may fall on the next pixel."""
    picture, reports = drawn(name, device, contents)
    before, told = kept(name)
    assert picture.shape == before.shape
    apart = np.abs(picture.astype(int) - before).max(axis=-1)
    if device.is_software and not device.is_opengl:
        assert apart.max() <= 1, f"{(apart > 1).sum()} pixels, by up to {apart.max()} codes"
    assert (apart > 4).mean() < 0.01
    assert [len(rows) for rows in reports] == [len(rows) for rows in told]
    for row, known in zip(itertools.chain(*reports), itertools.chain(*told), strict=True):
        assert row.keys() == known.keys()
        for field, value in known.items():
            exact = value is None or isinstance(value, str)
            assert row[field] == (value if exact else pytest.approx(value, rel=1e-3)), field
