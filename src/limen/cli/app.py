"""The command line: verbs are found by name and imported only when typed."""

from __future__ import annotations

import _thread
import contextlib
import dataclasses
import difflib
import math
import os
import sys
import threading
import traceback
from collections.abc import Sequence

from cyclopts import App, CycloptsError, Parameter
from cyclopts.exceptions import UnusedCliTokensError

from limen.errors import InputError, LimenError

__all__ = ["app", "main"]

_VERBS = {
    "demo": ("Walk a visitor through the Reality Deck and write an illustrated report.", "--content panorama.jpg"),
    "doctor": ("What this machine can do, what is missing, and the command that mends it.", "--json"),
    "sample": ("Make test data of any size.", "image world.tif --gigapixels 1"),
    "info": ("What a file is.", "mars.tif"),
    "ingest": ("Make a file ready: a pyramid that is opened in place.", "panorama.png panorama.tif"),
    "display": ("Check, list, draw or convert a display.", "reality-deck --picture room.png"),
    "walk": ("Make a session: visitors who walk in front of a display.", "--display rostock --seconds 60 walk.csv"),
    "show": (
        "Draw content on a display: a window, or files with --out.",
        "mars.tif --display reality-deck --session A --frames 3 --out frames --scale 0.125 --simulate",
    ),
    "traffic": (
        "Count what would have to move, frame by frame.",
        "one-to-one --display reality-deck --panels 'front/*' 'left/*' 'right/*' --session A B C",
    ),
    "verify": (
        "Let an independent model of vision look for what limen leaves out.",
        "mars.tif --display reality-deck --policy acuity contrast --plot verdict.png",
    ),
    "calibrate": (
        "Find where panels really hang, from photographs of boards that they show.",
        "boards --display wall.toml --out boards",
    ),
    "bench": ("The benchmark tables of the documentation.", "image --quick"),
}
"""What each verb does, and an example. ``limen.cli.<verb>:<verb>`` is imported only when it is typed."""

_TAKES = {
    "demo": "an image of yours by --content alone",
    "doctor": "options alone",
    "sample": "one kind and one file",
    "info": "one file at a time",
    "ingest": "one file and the name of what to make of it",
    "display": "one display at a time",
    "walk": "one session file to write",
    "show": "contents, or one show file",
    "traffic": "one content at a time",
    "verify": "one content at a time",
    "calibrate boards": "options alone",
    "calibrate rehearse": "options alone",
    "bench": "one benchmark at a time",
}
"""What each verb takes besides options; whatever is more is not understood."""

_EXIT_OURS, _EXIT_INPUT, _EXIT_INTERRUPTED = 1, 2, 130


def _version() -> str:
    from importlib.metadata import version  # 15 ms that only --version needs

    return f"limen {version('limen')}"


def _all_finite(_: object, value: object) -> None:
    """Of every option, and of those that a group holds: Python reads nan and inf as numbers, and nothing here does.

    Raises
    ------
    InputError
        Naming an option of a group; cyclopts names the others.
    """
    if dataclasses.is_dataclass(value):
        for field in dataclasses.fields(value):
            if not _is_finite(getattr(value, field.name)):
                raise InputError(f"--{field.name.replace('_', '-')} takes finite numbers alone")
    elif not _is_finite(value):
        raise InputError("it takes finite numbers alone")


def _is_finite(value: object) -> bool:
    if isinstance(value, list | tuple):
        return all(map(_is_finite, value))
    return not isinstance(value, float) or math.isfinite(value)


app = App(
    name="limen",
    help="Gigapixel images and 3-D scenes on any display of flat panels, drawn to the threshold of what a viewer sees.",
    version=_version,
    suppress_keyboard_interrupt=False,  # `main` says so itself
    default_parameter=Parameter(validator=_all_finite),
)
_GROUPS = ("calibrate",)
"""Verbs that have verbs of their own: ``limen.cli.<verb>:app``."""

for _verb, (_summary, _example) in _VERBS.items():
    app.command(
        f"limen.cli.{_verb}:{'app' if _verb in _GROUPS else _verb}",
        name=_verb,
        help=f"{_summary}\n\nExample: limen {_verb} {_example}",
    )


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command line and exit: 0 done, 2 the input is wrong, 1 limen's own fault, 130 interrupted."""
    words = list(sys.argv[1:] if arguments is None else arguments)
    if sys.unraisablehook is sys.__unraisablehook__:
        sys.unraisablehook = _interrupt_again
    if words and not words[0].startswith("-") and words[0] not in _VERBS:
        close = difflib.get_close_matches(words[0], _VERBS, n=1)
        meant = f"; did you mean '{close[0]}'?" if close else ""
        _fail(f"no verb is named '{words[0]}': there are {', '.join(_VERBS)}{meant}", _EXIT_INPUT)
    try:
        app(words, exit_on_error=False, print_error=False)
    except UnusedCliTokensError as error:
        _fail(_too_many(words, error.unused_tokens or []), _EXIT_INPUT)
    except CycloptsError as error:
        cause = str(error.__cause__) if isinstance(error.__cause__, InputError) else ""
        if cause.startswith("--"):
            _fail(cause, _EXIT_INPUT)
        _fail(str(error).splitlines()[0] + f" (limen {_verb_of(words)}--help shows the options)", _EXIT_INPUT)
    except LimenError as error:
        _fail(" ".join(str(error).split()), _EXIT_INPUT)
    except KeyboardInterrupt:
        _fail("interrupted", _EXIT_INTERRUPTED)
    except BrokenPipeError:
        # The reader of our output went away (`limen ... | head`): nobody is left to tell.
        with contextlib.suppress(OSError):
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        sys.exit(0)
    except Exception as error:
        if _was_interrupted(error):
            _fail("interrupted", _EXIT_INTERRUPTED)
        if "-v" in words or "--verbose" in words:
            traceback.print_exc()
        _fail(
            f"a fault in limen itself: {type(error).__name__}: {error} (-v shows the traceback)",
            _EXIT_OURS,
        )


def _interrupt_again(unraisable: sys.UnraisableHookArgs) -> None:
    """Ctrl-C that falls into a finaliser (of a GPU object, say) is dropped by Python: once more, a moment later."""
    if unraisable.exc_type is KeyboardInterrupt:
        threading.Timer(0.05, _thread.interrupt_main).start()
    else:
        sys.__unraisablehook__(unraisable)


def _was_interrupted(error: BaseException | None) -> bool:
    """Whether Ctrl-C is behind an error: who is interrupted while importing says that a module cannot be imported."""
    while error is not None:
        if isinstance(error, KeyboardInterrupt):
            return True
        error = error.__cause__ or error.__context__
    return False


def _too_many(words: list[str], unused: Sequence[str]) -> str:
    """What to say of words that no verb has a use for."""
    verb = next(verb for verb in (" ".join(words[:2]), words[0]) if verb in _TAKES)
    listed = ", ".join(f"'{word}'" for word in unused)
    return f"limen {verb} takes {_TAKES[verb]}: leave out {listed}"


def _verb_of(words: list[str]) -> str:
    return f"{words[0]} " if words and words[0] in _VERBS else ""


def _fail(message: str, code: int) -> None:
    sys.stderr.write(f"limen: {message}\n")
    sys.exit(code)
