"""What set-up has been done, what is still missing, and the lock that lets one process at a time do it.

Everything is in ``.limen/`` of the checkout: ``setup.json`` (the stamp, written last and atomically),
``unfinished`` (a set-up began and has not ended), ``lock``.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import sys
from collections.abc import Callable, Iterator, Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

try:
    import fcntl
except ImportError:  # Windows: concurrent first starts are then not serialised
    fcntl = None  # type: ignore[assignment]

__all__ = [
    "CALIBRATE",
    "DRIVER",
    "ENVIRONMENT",
    "OBSERVER",
    "TEST",
    "Checkout",
    "Need",
    "SetupError",
    "Stamp",
    "locked",
    "missing",
]

ENVIRONMENT, TEST, OBSERVER, CALIBRATE, DRIVER = "environment", "test", "observer", "calibrate", "driver"
"""The five steps, in the order in which they are done."""

_FORMAT = 2
_DRIVER_VARIABLES = ("VK_DRIVER_FILES", "VK_ICD_FILENAMES", "VK_LOADER_DRIVERS_DISABLE", "LD_LIBRARY_PATH")
_DRIVER_FOLDERS = (
    "/usr/share/vulkan/icd.d",
    "/etc/vulkan/icd.d",
    "/usr/share/glvnd/egl_vendor.d",
    "/dev/dri",
)


class SetupError(Exception):
    """Set-up cannot go on; the message is the one line to show."""

    def __init__(self, message: str, code: int = 1) -> None:
        super().__init__(message)
        self.code = code


@dataclass(frozen=True)
class Need:
    """What a verb cannot start without, beside the environment."""

    test: bool = False
    driver: bool = False
    observer: bool = False
    calibrate: bool = False
    goes_on: bool = False
    """Without a driver too: doctor reports it, and most tests draw nothing."""


@dataclass(frozen=True)
class Stamp:
    """What a finished set-up leaves behind; fingerprints tell whether it still holds."""

    environment: str = ""
    test: bool = False
    observer: bool = False
    calibrate: bool = False
    driver: str = ""
    driver_variables: dict[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class Checkout:
    """The places of one checkout."""

    root: Path

    @property
    def venv(self) -> Path:
        return self.root / ".venv"

    @property
    def python(self) -> Path:
        return self.venv / ("Scripts/python.exe" if os.name == "nt" else "bin/python")

    @property
    def notes(self) -> Path:
        return self.root / ".limen"

    @property
    def unfinished(self) -> Path:
        return self.notes / "unfinished"

    def read_stamp(self) -> Stamp:
        """The stamp, or an empty one where there is none that can be read, or a set-up broke off since."""
        if self.unfinished.exists():
            return Stamp()
        try:
            return Stamp(**json.loads((self.notes / "setup.json").read_text()))
        except (OSError, ValueError, TypeError):
            return Stamp()

    def write_stamp(self, stamp: Stamp) -> None:
        temporary = self.notes / f"setup.{os.getpid()}.tmp"
        temporary.write_text(json.dumps(asdict(stamp), indent=1))
        temporary.replace(self.notes / "setup.json")

    def environment_fingerprint(self) -> str:
        """Changes with pyproject.toml, the checkout's place, and the .venv or the Python under it.

        An editable install holds absolute paths, so a moved checkout is a new one; and a system's Python
        that was upgraded under a .venv leaves its packages behind.
        """
        try:
            about = (self.venv / "pyvenv.cfg").stat()
            parts: list[Any] = [
                _FORMAT,
                str(self.root),
                os.path.realpath(self.python),
                about.st_ino,
                about.st_mtime_ns,
            ]
            if not self.python.exists():
                return ""
            text = (self.root / "pyproject.toml").read_bytes()
        except OSError:
            return ""
        return hashlib.sha256(repr(parts).encode() + text).hexdigest()[:20]


def driver_fingerprint(variables: Mapping[str, str]) -> str:
    """Changes when a driver is installed or removed, or the user points the loader elsewhere."""
    parts: list[object] = [_FORMAT, [variables.get(name, "") for name in _DRIVER_VARIABLES]]
    for folder in _DRIVER_FOLDERS:
        with contextlib.suppress(OSError):
            parts.append((folder, sorted(os.listdir(folder))))  # noqa: PTH208 - os.listdir is the cheap one
    return hashlib.sha256(repr(parts).encode()).hexdigest()[:20]


def missing(stamp: Stamp, need: Need, environment: str, driver: str) -> tuple[str, ...]:
    """The steps to do: a pure table of the stamp against what is there now.

    A new environment also looks for the driver again: the answer came from the wgpu that was in the old one.
    """
    if not environment or stamp.environment != environment:
        kept = {TEST: stamp.test, OBSERVER: stamp.observer, CALIBRATE: stamp.calibrate}
        return (ENVIRONMENT, *(s for s in (TEST, OBSERVER, CALIBRATE, DRIVER) if getattr(need, s) or kept.get(s)))
    steps: tuple[str, ...] = ()
    if need.test and not stamp.test:
        steps += (TEST,)
    if need.observer and not stamp.observer:
        steps += (OBSERVER,)
    if need.calibrate and not stamp.calibrate:
        steps += (CALIBRATE,)
    if need.driver and (stamp.driver != driver or not _files_exist(stamp.driver_variables)):
        steps += (DRIVER,)
    return steps


def _files_exist(variables: Mapping[str, str]) -> bool:
    """Whether the driver that we unpacked is still in the cache folder."""
    names = variables.get("VK_DRIVER_FILES", "")
    return all(Path(name).exists() for name in names.split(os.pathsep) if name)


@contextlib.contextmanager
def locked(checkout: Checkout, say: Callable[[str], None]) -> Iterator[None]:
    """Hold the checkout's lock; whoever comes second waits, and is told so. The kernel frees it if we die."""
    try:
        checkout.notes.mkdir(exist_ok=True)
        handle = (checkout.notes / "lock").open("w")
    except OSError as error:
        raise SetupError(
            f"cannot set up: {checkout.root} is not writable ({error.strerror}); run ./limen once as its owner"
        ) from None
    with handle:
        if fcntl is not None and sys.platform != "win32":
            try:
                fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                say("another ./limen is setting up this checkout; waiting for it")
                fcntl.flock(handle, fcntl.LOCK_EX)
        yield
