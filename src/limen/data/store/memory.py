"""How much time something takes, and how much memory of its own a process needs meanwhile."""

from __future__ import annotations

import re
import sys
import threading
import time
from pathlib import Path
from types import TracebackType

__all__ = ["Footprint", "anonymous_bytes"]

_STATUS = Path("/proc/self/status")
_PERIOD_S = 0.02


def anonymous_bytes() -> int:
    """Resident anonymous memory now: what the process itself allocated, not the files that it has mapped.

    Where the system does not tell (outside Linux): the highest resident size so far, or 0.
    """
    try:
        found = re.search(r"RssAnon:\s+(\d+) kB", _STATUS.read_text())
    except OSError:
        found = None
    if found:
        return int(found[1]) * 1024
    if sys.platform == "win32":
        return 0
    import resource  # exists on Unix only

    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return int(peak) if sys.platform == "darwin" else int(peak) * 1024


class Footprint:
    """``with Footprint() as used: ...`` then ``used.seconds``, and ``used.peak_mib``, sampled every 20 ms."""

    def __init__(self) -> None:
        self._peak_bytes = 0
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._watch, daemon=True)

    @property
    def peak_mib(self) -> float:
        return self._peak_bytes / (1 << 20)

    @property
    def seconds(self) -> float:
        """From the beginning to the end, or until now."""
        return (self._end_s or time.perf_counter()) - self._begin_s

    def __enter__(self) -> Footprint:
        self._begin_s, self._end_s = time.perf_counter(), 0.0
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._end_s = time.perf_counter()
        self._stop.set()
        self._thread.join()

    def _watch(self) -> None:
        while True:
            self._peak_bytes = max(self._peak_bytes, anonymous_bytes())
            if self._stop.wait(_PERIOD_S):
                return
