"""What all tests share: the adapter, and the real files."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from limen.system import cache_folder
from support import doctests
from support.costs import Costs

# Tests that move the cache elsewhere would compile all loops again; read when Numba is imported, also by children.
os.environ.setdefault("NUMBA_CACHE_DIR", str(cache_folder() / "numba"))

_REPOSITORY = Path(__file__).resolve().parents[1]


def pytest_configure(config: pytest.Config) -> None:
    """By name, for src/limen too; what this file itself held would be of its folder alone."""
    config.pluginmanager.register(Costs(config), "costs")
    config.pluginmanager.register(doctests, "doctests of limen")


@pytest.fixture(scope="session")
def data_dir() -> Path:
    """The folder of real files: ``LIMEN_DATA``, else ``../shared/data`` beside the repository."""
    named = os.environ.get("LIMEN_DATA")
    folders = [Path(named)] if named else [_REPOSITORY.parent / "shared/data", _REPOSITORY.parents[1] / "shared/data"]
    for folder in folders:
        if folder.is_dir():
            return folder
    pytest.skip(f"NO REAL DATA: set LIMEN_DATA to the folder of real files (looked in {', '.join(map(str, folders))})")


@pytest.fixture(scope="session")
def device() -> Iterator[Any]:
    """The graphics adapter; a software driver is enough."""
    from limen.errors import NoAdapterError
    from limen.gpu.device import open_device

    try:
        opened = open_device()
    except NoAdapterError as error:
        pytest.skip(f"NO GRAPHICS ADAPTER, so nothing that is drawn was tested: {error}")
    yield opened
    opened.destroy()


@pytest.fixture(scope="session")
def observer() -> Any:
    """The independent observer, on its default display."""
    from limen.study.observer import INSTALL, Observer, missing_packages

    if missing_packages():
        pytest.skip(f"NO INDEPENDENT OBSERVER, so nothing that is drawn was judged: {' && '.join(INSTALL)}")
    return Observer()


@pytest.fixture(scope="session")
def memory_image() -> Any:
    """Makes images in memory, of pixels."""
    from support.studio import MemoryImage

    return MemoryImage


@pytest.fixture(scope="session")
def studio(device: Any) -> Any:
    """Draws images in memory."""
    from support.studio import Studio

    return Studio(device)
