"""uv, then .venv, then limen and its dependencies in it.

uv because it does in seconds what pip does in minutes, and because it needs neither venv nor ensurepip, which
Debian's bare python3 lacks. It comes from PATH, from pip (``--target .boot``: no system package is touched,
so PEP 668 has nothing to forbid), or straight from PyPI's index.
"""

from __future__ import annotations

import hashlib
import io
import json
import os
import platform
import shutil
import ssl
import sys
import tomllib
import urllib.request
import zipfile
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from launcher.run import run
from launcher.state import Checkout, SetupError
from launcher.variables import home_is_writable

__all__ = ["find_uv", "group_requirements", "install", "install_calibration", "install_observer", "pick_wheel"]

OBSERVER_PACKAGES = ("torch==2.13.0", "cvvdp==0.5.7")
"""Without their dependencies, of which one would bring CUDA; the few that are needed are the extra ``verify``."""

_CPU_INDEX = "https://download.pytorch.org/whl/cpu"

_INDEX = "https://pypi.org/simple/uv/"
_WHEEL_TAGS = {
    ("Linux", "x86_64"): "manylinux_2_17_x86_64",
    ("Linux", "aarch64"): "manylinux_2_17_aarch64",
    ("Darwin", "arm64"): "macosx_11_0_arm64",
    ("Darwin", "x86_64"): "macosx_10_12_x86_64",
    ("Windows", "AMD64"): "win_amd64",
}


def install(checkout: Checkout, test: bool, say: Callable[[str], None]) -> None:
    """Make .venv if there is none (or only the ruins of one) and install limen into it, editable."""
    uv = find_uv(checkout, say)
    variables = _uv_variables(checkout)
    if checkout.unfinished.exists():
        shutil.rmtree(checkout.venv, ignore_errors=True)  # nobody knows how far the last one came
    checkout.unfinished.touch()
    if not _usable(checkout):
        shutil.rmtree(checkout.venv, ignore_errors=True)
        made = run([uv, "venv", "--quiet", "--python", sys.executable, checkout.venv], checkout.root, variables)
        if made.code:
            raise SetupError(f"could not make {checkout.venv}: {made.reason}")
    wanted = ["--editable", str(checkout.root)]
    if test:
        wanted += group_requirements(checkout.root / "pyproject.toml", "test")
    say(
        "installing limen, its dependencies and the tools of the tests into .venv"
        if test
        else "installing limen and its dependencies into .venv"
    )
    done = run([uv, "pip", "install", "--quiet", "--python", checkout.python, *wanted], checkout.root, variables)
    # Here uv ended by itself, and it resolves and downloads before it touches .venv: what is there is whole.
    # So whoever asks for the tests without a network keeps the .venv that works.
    checkout.unfinished.unlink()
    if done.code:
        raise SetupError(f"uv could not install: {done.reason}")


def install_observer(checkout: Checkout, say: Callable[[str], None]) -> str:
    """Install what `limen verify` judges with; an empty answer means that it worked, else why it did not."""
    uv, variables = find_uv(checkout, say), _uv_variables(checkout)
    if not variables.get("UV_FIND_LINKS") and os.environ.get("PIP_FIND_LINKS"):
        # Where a machine brings wheels of its own for pip, its build of torch for CPUs is among them.
        variables["UV_FIND_LINKS"] = ",".join(os.environ["PIP_FIND_LINKS"].split())
    say("installing the independent observer (PyTorch for CPUs, about 200 MB) into .venv")
    into: list[str | Path] = [uv, "pip", "install", "--quiet", "--python", checkout.python]
    pinned = [*into, "--no-deps", *OBSERVER_PACKAGES]
    reasons = []
    for command in ([*pinned, "--extra-index-url", _CPU_INDEX], [*pinned, f"{OBSERVER_PACKAGES[0]}+cpu"]):
        done = run(command, checkout.root, variables)
        if done.code == 0:
            done = run([*into, "--editable", f"{checkout.root}[verify]"], checkout.root, variables)
            return done.reason if done.code else ""
        reasons.append(done.reason)
    return reasons[0]


def install_calibration(checkout: Checkout, say: Callable[[str], None]) -> str:
    """Install what `limen calibrate` sees markers with; an empty answer means that it worked, else why it did not."""
    say("installing OpenCV (about 60 MB) into .venv")
    extra: list[str | Path] = ["--editable", f"{checkout.root}[calibrate]"]
    uv = find_uv(checkout, say)
    done = run([uv, "pip", "install", "--quiet", "--python", checkout.python, *extra], None, _uv_variables(checkout))
    return done.reason if done.code else ""


def group_requirements(pyproject: Path, group: str) -> list[str]:
    """A dependency group's lines, read here because ``uv pip install --group`` is younger than many a uv."""
    lines = tomllib.loads(pyproject.read_text())["dependency-groups"][group]
    return [line for line in lines if isinstance(line, str)]


def find_uv(checkout: Checkout, say: Callable[[str], None]) -> Path:
    """A uv that runs: on PATH, in .boot, or put there now."""
    on_path = shutil.which("uv")
    boot = checkout.root / ".boot"
    for path in (Path(on_path) if on_path else None, _uv_in(boot)):
        # Version managers leave shims of tools that are not installed: only one that answers counts.
        if path and run([path, "--version"]).code == 0:
            return path
    say("fetching uv, which makes the environment, into .boot")
    reasons = []
    for way in (_uv_by_pip, _uv_from_index):
        fresh = checkout.root / f".boot.{os.getpid()}.tmp"
        try:
            reason = way(fresh)
            if not reason:
                shutil.rmtree(boot, ignore_errors=True)
                fresh.rename(boot)
                return _uv_in(boot)
        finally:
            shutil.rmtree(fresh, ignore_errors=True)
        reasons.append(reason)
    raise SetupError(
        "found no uv and could not fetch it; install it (https://docs.astral.sh/uv) or check the network: "
        + "; ".join(reasons)
    )


def _uv_in(folder: Path) -> Path:
    return folder / "bin" / ("uv.exe" if os.name == "nt" else "uv")


def _uv_by_pip(folder: Path) -> str:
    """Install uv with this Python's pip; an empty answer means that it worked."""
    if run([sys.executable, "-m", "pip", "--version"]).code:
        return "this Python has no pip"
    command = [sys.executable, "-m", "pip", "install", "--quiet", "--disable-pip-version-check"]
    result = run([*command, "--target", folder, "uv"])
    if result.code:
        return f"pip: {result.reason}"
    return "" if run([_uv_in(folder), "--version"]).code == 0 else "pip brought a uv that does not run"


def _uv_from_index(folder: Path) -> str:
    """Take uv's one file out of its wheel, checksum verified; an empty answer means that it worked."""
    tag = _WHEEL_TAGS.get((platform.system(), platform.machine()))
    if tag is None:
        return f"no wheel of uv is known for {platform.system()} {platform.machine()}"
    try:
        request = urllib.request.Request(_INDEX, headers={"Accept": "application/vnd.pypi.simple.v1+json"})
        with urllib.request.urlopen(request, timeout=60) as answer:
            wheel = pick_wheel(json.load(answer)["files"], tag)
        with urllib.request.urlopen(wheel["url"], timeout=600) as answer:
            content = answer.read()
        if hashlib.sha256(content).hexdigest() != wheel["hashes"]["sha256"]:
            return "PyPI: the wheel of uv arrived damaged"
        path = _uv_in(folder)
        path.parent.mkdir(parents=True)
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            name = next(n for n in archive.namelist() if n.endswith(f"/scripts/{path.name}"))
            path.write_bytes(archive.read(name))
        path.chmod(0o755)
    except (OSError, ValueError, KeyError, LookupError, StopIteration, zipfile.BadZipFile) as error:
        return f"PyPI: {error}"
    return "" if run([path, "--version"]).code == 0 else "PyPI's uv does not run here"


def pick_wheel(files: Sequence[dict[str, Any]], tag: str) -> dict[str, Any]:
    """The newest wheel for this platform; the index promises no order."""

    def version(file: dict[str, Any]) -> tuple[int, ...]:
        return tuple(int(part) for part in file["filename"].split("-")[1].split("."))

    fitting = [
        f
        for f in files
        if f["filename"].endswith(".whl")
        and tag in f["filename"]
        and not f.get("yanked")
        and f["filename"].split("-")[1].replace(".", "").isdigit()  # no release candidates
    ]
    if not fitting:
        raise LookupError(f"no wheel of uv for {tag}")
    return max(fitting, key=version)


def _usable(checkout: Checkout) -> bool:
    return (
        checkout.python.exists()
        and run([checkout.python, "-c", "import sys; sys.exit(sys.prefix == sys.base_prefix)"]).code == 0
    )


def _uv_variables(checkout: Checkout) -> dict[str, str]:
    """uv's settings: this Python and no other, the system's certificates, a cache that can be written."""
    variables = dict(os.environ)
    variables.setdefault("UV_PYTHON_DOWNLOADS", "never")
    paths = ssl.get_default_verify_paths()
    if paths.cafile or (paths.capath and any(Path(paths.capath).iterdir())):
        # uv trusts its own list otherwise, and a firm's proxy is only in the system's. (Its old and its new name.)
        variables.setdefault("UV_NATIVE_TLS", "1")
        variables.setdefault("UV_SYSTEM_CERTS", "1")
    if "UV_CACHE_DIR" not in variables and not home_is_writable():
        variables["UV_CACHE_DIR"] = str(checkout.root / ".cache" / "uv")
    return variables
