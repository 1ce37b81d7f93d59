"""Arguments in, the real command out: what does the verb need, is it there, set it up, become the verb."""

from __future__ import annotations

import dataclasses
import os
import signal
import sys
import time
from collections.abc import Mapping, Sequence
from pathlib import Path

from launcher.state import (
    CALIBRATE,
    DRIVER,
    ENVIRONMENT,
    OBSERVER,
    TEST,
    Checkout,
    Need,
    SetupError,
    Stamp,
    driver_fingerprint,
    locked,
    missing,
)
from launcher.variables import merged, runtime_variables

__all__ = ["command", "main", "need_of", "prepare"]

_DRAWING_VERBS = ("demo", "show", "bench", "verify")
_OBSERVING_VERBS = ("verify", "test")
_GOING_ON_VERBS = ("doctor", "test")
_TEST_HELP = """usage: ./limen test [--backend vulkan|opengl|both] [PYTEST ARGS]

Runs all checks of this checkout: formatting, types, import directions, then the tests.
With arguments only pytest runs, with these: ./limen test tests/cli -k doctor

--backend   what the tests draw with; without it the best adapter there is. both: all tests on that, then those that
            draw each kind of content (marked 'drawing') on OpenGL.
"""


def main(arguments: Sequence[str]) -> int:
    """Returns only if something went wrong (or on Windows, which cannot replace a process)."""
    root = Path(__file__).resolve().parents[2]
    if arguments[:1] == ["test"] and set(arguments[1:]) & {"--help", "-h"}:
        sys.stdout.write(_TEST_HELP)
        return 0
    signal.signal(signal.SIGTERM, _terminated)
    try:
        python, variables = _ready(Checkout(root), need_of(arguments))
    except SetupError as error:
        say(str(error))
        return error.code
    except KeyboardInterrupt:
        say("set-up interrupted; the next start does it again")
        return 130
    except OSError as error:
        say(f"set-up failed: {error}")
        return 1
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    words = command(root, python, arguments)
    if os.name == "nt":
        import subprocess

        return subprocess.call(words, env=variables)
    return os.execve(words[0], words, variables)


def need_of(arguments: Sequence[str]) -> Need:
    """What these arguments need; help never waits for a driver, nor does a verb that draws nothing."""
    verb = arguments[0] if arguments else ""
    helps = bool(set(arguments) & {"--help", "-h", "--version"})
    goes_on = verb in _GOING_ON_VERBS
    return Need(
        test=verb == "test",
        driver=(verb in _DRAWING_VERBS or goes_on) and not helps,
        calibrate=verb == "calibrate" and not helps,
        observer=(verb in _OBSERVING_VERBS or list(arguments[:2]) == ["bench", "kernels"]) and not helps,
        goes_on=goes_on,
    )


def command(root: Path, python: Path, arguments: Sequence[str]) -> list[str]:
    """The process to become; -P keeps the folder we are started in out of the import path."""
    if arguments[:1] == ["test"]:
        return [str(python), "-P", str(root / "tools" / "launcher" / "checks.py"), *arguments[1:]]
    return [str(python), "-P", "-m", "limen.cli", *arguments]


def _ready(checkout: Checkout, need: Need) -> tuple[Path, dict[str, str]]:
    if os.environ.get("LIMEN_NO_SETUP"):
        python = checkout.python if checkout.python.exists() else Path(sys.executable)
        path = os.pathsep.join(filter(None, [str(checkout.root / "src"), os.environ.get("PYTHONPATH")]))
        return python, {**os.environ, "PYTHONPATH": path}
    stamp = prepare(checkout, need)
    return checkout.python, _variables(checkout, stamp, os.environ)


def prepare(checkout: Checkout, need: Need) -> Stamp:
    """Do the steps that are missing. The usual start reads two small files here and does nothing else."""
    stamp = checkout.read_stamp()
    if not _missing(checkout, stamp, need):
        return stamp
    began = time.monotonic()
    with locked(checkout, say):
        stamp = checkout.read_stamp()  # somebody else may have done it while we waited
        steps = _missing(checkout, stamp, need)
        if ENVIRONMENT in steps or TEST in steps:
            stamp = _environment(checkout, stamp, steps)
        for extra in (OBSERVER, CALIBRATE):
            if extra in steps:
                stamp = _extra(checkout, stamp, extra)
        if DRIVER in steps:
            stamp = _driver(checkout, stamp, need)
    if steps:
        say(f"ready in {time.monotonic() - began:.0f} s")
    return stamp


def _missing(checkout: Checkout, stamp: Stamp, need: Need) -> tuple[str, ...]:
    return missing(stamp, need, checkout.environment_fingerprint(), driver_fingerprint(os.environ))


def _environment(checkout: Checkout, stamp: Stamp, steps: Sequence[str]) -> Stamp:
    from launcher.environment import install  # urllib, ssl, zipfile: 60 ms that a usual start never needs

    install(checkout, TEST in steps, say)
    if ENVIRONMENT in steps:
        stamp = Stamp()
    stamp = dataclasses.replace(stamp, environment=checkout.environment_fingerprint(), test=TEST in steps)
    checkout.write_stamp(stamp)
    return stamp


def _extra(checkout: Checkout, stamp: Stamp, extra: str) -> Stamp:
    from launcher.environment import install_calibration, install_observer

    name, install = {
        OBSERVER: ("the independent observer", install_observer),
        CALIBRATE: ("OpenCV, which calibration needs,", install_calibration),
    }[extra]
    reason = install(checkout, say)
    if reason:
        # The verb then says what to type, and its tests skip; everything else works, and the next start tries again.
        say(f"{name} could not be installed, its tests are skipped: {reason}")
        return stamp
    stamp = Stamp(**{**dataclasses.asdict(stamp), extra: True})
    checkout.write_stamp(stamp)
    return stamp


def _driver(checkout: Checkout, stamp: Stamp, need: Need) -> Stamp:
    from launcher.driver import find

    try:
        found = find(checkout, say)
    except SetupError as error:
        if error.code != 2 or not need.goes_on:
            raise
        say(str(error))  # doctor is there to tell of it, and the tests that need no adapter can still be run
        return stamp
    # The fingerprint is taken afterwards: installing a driver changes what it looks at.
    stamp = dataclasses.replace(stamp, driver=driver_fingerprint(os.environ), driver_variables=found)
    checkout.write_stamp(stamp)
    return stamp


def _variables(checkout: Checkout, stamp: Stamp, base: Mapping[str, str]) -> dict[str, str]:
    return merged({**base, **runtime_variables(checkout.root)}, stamp.driver_variables)


def say(text: str) -> None:
    """One line on stderr: stdout belongs to the verb."""
    sys.stderr.write(f"limen: {text}\n")
    sys.stderr.flush()


def _terminated(*_: object) -> None:
    # As an exception, so that the program that runs for us is stopped too instead of being orphaned.
    raise KeyboardInterrupt
