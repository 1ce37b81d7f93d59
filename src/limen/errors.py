"""One tree of errors; every one is also the builtin that a caller would expect.

::

    LimenError
    ├── InputError (ValueError)              what the user gave is wrong
    │   ├── MissingFileError (FileNotFoundError)
    │   ├── FormatError                      a file's content cannot be used
    │   │   └── NeedsIngestError             it can, once `limen ingest` has made it ready
    │   ├── DisplayError                     a display's geometry cannot be used
    │   └── SessionError                     a track of viewers cannot be used
    ├── StorageError (OSError)               the disk refused: full, read-only
    ├── PageError (OSError)                  one page of an image could not be read
    └── DeviceError (RuntimeError)           the graphics adapter
        ├── NoAdapterError                   there is none
        └── DeviceLimitError                 it cannot do what was asked

A message says what is wrong, where (file, line, field), and what to do about it, in one line.
The command line prints that line and exits with code 2; anything outside this tree is limen's own fault.
"""

from __future__ import annotations

__all__ = [
    "DeviceError",
    "DeviceLimitError",
    "DisplayError",
    "FormatError",
    "InputError",
    "LimenError",
    "MissingFileError",
    "NeedsIngestError",
    "NoAdapterError",
    "PageError",
    "SessionError",
    "StorageError",
]


class LimenError(Exception):
    """Root of every error that limen raises on purpose."""


class InputError(LimenError, ValueError):
    """What the user gave is wrong."""


class MissingFileError(InputError, FileNotFoundError):
    """A file that was named does not exist."""


class FormatError(InputError):
    """A file exists and its content cannot be used."""


class NeedsIngestError(FormatError):
    """A file is too large to be shown as it is; ``limen ingest`` makes it ready."""


class DisplayError(InputError):
    """A display's geometry cannot be used."""


class SessionError(InputError):
    """A track of viewers cannot be used."""


class StorageError(LimenError, OSError):
    """The disk refused: full, read-only, no permission."""


class PageError(LimenError, OSError):
    """One page of an image could not be read."""


class DeviceError(LimenError, RuntimeError):
    """Something is wrong with the graphics adapter."""


class NoAdapterError(DeviceError):
    """No graphics adapter was found."""


class DeviceLimitError(DeviceError):
    """The adapter cannot do what was asked."""
