"""What ``limen show`` is asked for whatever the content is: who looks at which panels, what is written or opened."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Annotated, Literal, TypeAlias

import numpy as np
from cyclopts import Group, Parameter

from limen.cli.arguments import place
from limen.cli.output import Output
from limen.display.display import Display
from limen.errors import InputError
from limen.geometry import as_vec3
from limen.viewing.standing import standing_viewer
from limen.viewing.viewer import Pointer, Viewer, nobody_points

if TYPE_CHECKING:
    from limen.show.show import Tour
    from limen.show.views import ViewName
    from limen.track.session import Session

__all__ = ["FILES_DEFAULT", "WINDOWS_DEFAULT", "Asked", "FileOptions", "Overlays", "WindowOptions"]

Overlays: TypeAlias = Literal["none", "levels", "error", "panels", "patches", "simplified"]

PORT = 8080
"""Where a browser finds what is shown, unless another port is asked for."""

_STEP_S = 0.25  # between frames of a viewer who stands


@Parameter(name="*", group=Group("Files (with --out)"))
@dataclass(frozen=True, slots=True)
class FileOptions:
    """Options of pictures that are written."""

    frames: Annotated[int, Parameter(help="How many moments, spread over the session.")] = 1
    scale: Annotated[
        float,
        Parameter(
            help="Draw panels with fewer pixels (0.125: an eighth). Levels, pages and errors of an image are "
            "still told of the true panels; triangles and errors of anything else, of those that are drawn."
        ),
    ] = 1.0
    picture_format: Annotated[Literal["jpg", "png"], Parameter(name="--format")] = "jpg"
    simulate: Annotated[
        bool,
        Parameter(
            negative="",
            help="Of an image: also draw the room and the unrolled wall. Of anything else: also what the "
            "viewer's eye sees of the lit display (eye), and what is seen from elsewhere and from afar.",
        ),
    ] = False
    seen_from: Annotated[
        str, Parameter(allow_leading_hyphen=True, help="With --simulate: X,Y,Z of the second place to look from.")
    ] = ""


@Parameter(name="*", group=Group("Windows (without --out)"))
@dataclass(frozen=True, slots=True)
class WindowOptions:
    """Options of windows that are opened."""

    window: Annotated[
        Literal["eye", "unrolled", "outputs", "browser"] | None,
        Parameter(
            help="eye: what the viewer's eye sees of the simulated display (if not given; images alone are shown "
            "unrolled). unrolled: its panels side by side. outputs: the display's quilts, each on the screen that it "
            "is named after in the display file. browser: a page for browsers on this machine, instead of a window."
        ),
    ] = None
    port: Annotated[int, Parameter(help="Of the page for browsers; 0 takes a free one.")] = PORT
    seconds: Annotated[float | None, Parameter(help="Close the window after this long.")] = None

    def check(self, display: Display | None) -> None:
        """Raises InputError for what is asked for without a display, or a browser."""
        if self.view is not None and display is None:
            raise InputError(f"--window {self.view} says how a display is shown: give --display too")
        if self.window != "browser" and self.port != PORT:
            raise InputError("--port is of the page for browsers: give --window browser too")

    @property
    def view(self) -> ViewName | None:
        return None if self.window == "browser" else self.window


FILES_DEFAULT, WINDOWS_DEFAULT = FileOptions(), WindowOptions()


@dataclass(frozen=True, slots=True)
class Asked:
    """What is asked for whatever the content is.

    Viewers and what they look at stand where the whole display wants them, whichever panels are drawn.
    """

    whole: Display | None  # None: the window itself is the display
    panels: Sequence[str]
    session: str
    viewer: str
    overlay: Overlays
    files: FileOptions
    windows: WindowOptions
    gaze: str = ""
    tracker: str = ""

    def __post_init__(self) -> None:
        if self.files.frames < 1:
            raise InputError(f"--frames must be at least 1, got {self.files.frames}")
        self.windows.check(self.whole)
        if self.session and self.viewer:
            raise InputError("give --session or --viewer, not both")
        if self.tracker and (self.session or self.viewer):
            raise InputError("--tracker says who looks: leave out --session and --viewer")
        if self.gaze:
            place(self.gaze, "--gaze")
        if self.files.seen_from:
            place(self.files.seen_from, "--seen-from")
            if not self.files.simulate:
                raise InputError("--seen-from is a place to look at the simulated display from: give --simulate too")

    def say_scale(self, out: Output) -> None:
        """Say what is told of a preview, where that is not what the true panels would need."""
        if self.files.scale != 1:
            out.say(
                f"--scale {self.files.scale:g}: what is counted, and errors in pixels, are of the smaller panels that "
                "are drawn; without --scale, of the display's own"
            )

    @property
    def shown(self) -> Display | None:
        return self.whole.select(self.panels) if self.whole and self.panels else self.whole

    def stander(self) -> Viewer:
        if self.viewer:
            return self._gazing(Viewer(place(self.viewer, "--viewer")))
        return self._gazing(standing_viewer(self.whole) if self.whole else Viewer((0.0, 0.0, 0.0)))

    def tour(self) -> Tour:
        """Who looks at time t, as a function; a session is run again and again."""
        recorded = self._recorded()
        if recorded is not None:
            return lambda time_s: self._all_gazing(recorded.at(recorded.start_s + time_s % recorded.duration_s))
        person = self.stander()
        return lambda time_s: (replace(person, time_s=time_s),)

    def pointers(self) -> Callable[[float], Sequence[Pointer]]:
        """Who points where, by the viewers' clock."""
        recorded = self._recorded()
        return nobody_points if recorded is None else recorded.pointers_at

    def moments(self) -> list[Sequence[Viewer]]:
        """Who looks in each frame, spread over the session."""
        recorded = self._recorded()
        if recorded is None:
            tour = self.tour()
            return [tour(number * _STEP_S) for number in range(self.files.frames)]
        times_s = recorded.start_s + np.linspace(0, recorded.duration_s, self.files.frames + 2)[1:-1]
        return [self._all_gazing(recorded.at(float(time_s))) for time_s in times_s]

    def _all_gazing(self, viewers: Sequence[Viewer]) -> Sequence[Viewer]:
        return [self._gazing(viewer) for viewer in viewers]

    def _gazing(self, viewer: Viewer) -> Viewer:
        """The same person, who looks at the place that ``--gaze`` names, if it does."""
        if not self.gaze:
            return viewer
        way = np.array(place(self.gaze, "--gaze")) - viewer.position_m
        if not way.any():
            raise InputError(f"--gaze {self.gaze} is where the viewer's eyes are: give a place to look at")
        return replace(viewer, gaze=as_vec3(way, "gaze"))

    def _recorded(self) -> Session | None:
        """The session that was asked for; None where nobody walks."""
        if not (self.session and self.whole):
            return None
        from limen.track.walk import session_named  # SciPy takes most of a second

        return session_named(self.session, self.whole)
