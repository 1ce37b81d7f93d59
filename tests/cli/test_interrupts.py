"""Ctrl-C at moments when Python or a library would swallow it."""

from __future__ import annotations

import contextlib
import signal
import threading

import pytest

from limen.cli.app import main
from limen.system import interrupts_later
from support.processes import PYTHON, finished

DROPPED = """
import _thread, sys, time
from limen.cli import app

class Finalised:
    def __del__(self):
        _thread.interrupt_main()
        time.sleep(0.01)

def verb(*_, **__):
    Finalised()
    for _ in range(200):
        time.sleep(0.1)  # what is set inside of Python is seen between two sleeps, not during one

app.app = verb
app.main(["doctor"])
"""


def test_an_interrupt_that_falls_into_a_finaliser_comes_again() -> None:
    done = finished([*PYTHON, "-c", DROPPED], timeout_s=60)
    assert (done.returncode, done.stderr) == (130, "limen: interrupted\n")


def test_an_import_that_was_interrupted_is_no_fault(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def verb(*_: object, **__: object) -> None:
        try:
            raise KeyboardInterrupt
        except KeyboardInterrupt as interrupt:
            raise ImportError("Cannot import module") from interrupt

    monkeypatch.setattr("limen.cli.app.app", verb)
    with pytest.raises(SystemExit) as ended:
        main(["doctor"])
    assert ended.value.code == 130
    assert capsys.readouterr().err == "limen: interrupted\n"


def test_an_interrupt_that_a_package_would_swallow_comes_after_it() -> None:
    """trimesh takes one while it is imported for a package that is missing, and goes on without."""
    done = []

    def work() -> None:
        with interrupts_later():
            with contextlib.suppress(BaseException):
                signal.raise_signal(signal.SIGINT)
            done.append(True)

    with pytest.raises(KeyboardInterrupt):
        work()
    assert done
    with interrupts_later():
        pass
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


def test_other_threads_are_left_alone() -> None:
    seen = []

    def work() -> None:
        with interrupts_later():
            seen.append(signal.getsignal(signal.SIGINT))

    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    assert seen == [signal.default_int_handler]
