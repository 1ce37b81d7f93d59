"""The documentation builds without a warning, its links hold, and the built site asks nobody for anything."""

from __future__ import annotations

import os
import re
from pathlib import Path

import pytest

from support.processes import PYTHON, finished

ROOT = Path(__file__).resolve().parents[1]
PAGES = sorted([*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md")])
LINK = re.compile(r"\]\(([^)\s]+)\)")
LOADED = re.compile(r'<(?:script|link|img)[^>]+(?:src|href)="(https?://[^"]+)"')


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    pytest.importorskip("mkdocs")
    folder = tmp_path_factory.mktemp("docs") / "site"
    done = finished(
        # Its own deprecation warnings are not ours; --strict makes those about our pages fail.
        [*PYTHON, "-W", "ignore", "-m", "mkdocs", "build", "--quiet", "--strict", "--site-dir", folder],
        timeout_s=200,
        cwd=ROOT,
        env={**os.environ, "NO_MKDOCS_2_WARNING": "1"},
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return folder


def test_the_site_builds_strictly(site: Path) -> None:
    assert (site / "index.html").exists()


def test_the_site_loads_nothing_from_elsewhere(site: Path) -> None:
    """Links for readers may go anywhere; scripts, styles and pictures may not."""
    assert not {(page.name, address) for page in site.rglob("*.html") for address in LOADED.findall(page.read_text())}


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_relative_links_point_at_files(page: Path) -> None:
    text = re.sub(r"```.*?```", "", page.read_text(), flags=re.DOTALL)
    targets = [link.partition("#")[0] for link in LINK.findall(text) if not re.match(r"[a-z]+:|#", link)]
    assert not [target for target in targets if not (page.parent / target).exists()]


def test_the_first_page_leads_to_all_others() -> None:
    """All but single decisions, which have a list of their own."""
    folder = ROOT / "docs"
    linked = {
        (folder / link).resolve() for link in LINK.findall((folder / "index.md").read_text()) if link.endswith(".md")
    }
    pages = {page for page in folder.rglob("*.md") if page.parent.name != "decisions"} - {folder / "index.md"}
    assert pages <= linked
    decisions = folder / "explain/decisions"
    listed = {(decisions / link).resolve() for link in LINK.findall((decisions / "index.md").read_text())}
    assert set(decisions.glob("*.md")) - {decisions / "index.md"} == listed
