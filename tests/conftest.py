"""Fixtures that several test folders share."""

from __future__ import annotations

import os
from pathlib import Path

import pytest


@pytest.fixture(scope="session")
def data_dir() -> Path:
    """Folder of the real files: ``LIMEN_DATA``, else ``shared/data`` beside or above the checkout; skips without it."""
    root = Path(__file__).resolve().parents[1]
    given = os.environ.get("LIMEN_DATA")
    places = (
        [Path(given)] if given else [folder / "shared" / "data" for folder in (root, root.parent, root.parent.parent)]
    )
    for place in places:
        if (place / "image").is_dir():
            return place
    pytest.skip(f"NO REAL DATA: none of {', '.join(map(str, places))} holds it; set LIMEN_DATA to run these tests")
