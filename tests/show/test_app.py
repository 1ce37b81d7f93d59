"""Every kind in every view, on canvases that nobody sees, in a browser's page and in a notebook's cell."""

from __future__ import annotations

import asyncio
import io
import json
import threading
import time
import urllib.error
import urllib.request
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image as Picture

from limen.data.samples.mesh import torus_knot
from limen.display.display import Display
from limen.display.packing import pack_outlines
from limen.display.quilt import pieces
from limen.errors import DeviceError, InputError
from limen.frame.report import FrameReport
from limen.layers.base import Layer
from limen.layers.common.room_placement import RoomPlacement
from limen.layers.points.layer import PointsLayer
from limen.layers.terrain.layer import TerrainLayer
from limen.show.app import App, default_view, run_show
from limen.show.canvas import open_canvas
from limen.show.show import Show
from limen.show.views import unrolled_quilt
from limen.viewing.viewer import Viewer
from support.frames import VIEWER, WALL

pytestmark = [pytest.mark.gpu, pytest.mark.drawing]

MAPPED = replace(WALL.part(range(4)), quilts=tuple(pack_outlines(WALL.part(range(4)))))
Rgb = NDArray[np.uint8]


class Offscreen:
    """An app on canvases that nobody sees, and their pictures."""

    def __init__(self, device: Any, show: Show, display: Display | None, view: Any, who: Any = VIEWER) -> None:
        self.app = App(device, show, display, who, view)
        sizes = [quilt.size_px for quilt in display.quilts] if display and view == "outputs" else [(320, 200)]
        self.canvases = [open_canvas(device.wgpu, size, "test", backend="offscreen") for size in sizes]
        for number, canvas in enumerate(self.canvases):
            canvas.begin(lambda surface, number=number: self.app.draw(number, surface), lambda: False)  # type: ignore[misc]

    def pictures(self) -> list[Rgb]:
        """When all has come and faded in."""
        until = time.monotonic() + 60
        settled = 0
        while settled < 3:
            drawn = self._frame()
            report = self.app.last
            assert report is not None
            coming = report.missing + sum(row.uploads for row in report.layers)
            settled = 0 if coming else settled + 1
            assert time.monotonic() < until
        time.sleep(0.3)
        return self._frame()[: len(drawn)]

    def _frame(self) -> list[Rgb]:
        drawn = [np.asarray(canvas.canvas.draw())[..., :3] for canvas in self.canvases]
        for canvas in self.canvases:
            if canvas.fault is not None:
                raise canvas.fault
        return drawn

    def __enter__(self) -> Offscreen:
        return self

    def __exit__(self, *_: object) -> None:
        for canvas in self.canvases:
            canvas.canvas.close()
        self.app.close()


def shown(pictures: list[Rgb]) -> float:
    return float(np.mean([(picture.max(axis=-1) > 40).mean() for picture in pictures]))


@pytest.mark.parametrize("view", ["window", "unrolled", "eye", "outputs"])
def test_every_kind_is_shown_in_every_view(device: Any, view: str, layer: Layer) -> None:
    display: Display | None = {"window": None, "outputs": MAPPED}.get(view, WALL)
    who, name = (Viewer((0.0, 0.0, 0.0)), None) if display is None else (VIEWER, view)
    if display is None and isinstance(layer, PointsLayer):
        layer = replace(layer, stands=RoomPlacement())
    if display is None and isinstance(layer, TerrainLayer):
        layer = replace(layer, reference_m=who.position_m)
    with Show([layer], display) as show, Offscreen(device, show, display, name, who) as screen:
        drawn = screen.pictures()
        assert shown(drawn) > 0.02
        assert screen.app.last is not None
        assert screen.app.last.layers[0].kind == layer.kind
        for key in "op":  # another overlay and another policy: drawn without an error
            screen.app.handle({"event_type": "key_down", "key": key})
            screen._frame()
            screen.app.handle({"event_type": "key_down", "key": key})
        again = screen.pictures()
    for one, other in zip(drawn, again, strict=True):
        assert (np.abs(one.astype(int) - other).max(axis=-1) > 8).mean() < 0.002


def test_a_display_unrolled_shows_what_its_panels_show(device: Any, layers: dict[str, Layer]) -> None:
    layer = layers["mesh"]
    with Show([layer], WALL) as show:
        with Offscreen(device, show, WALL, "unrolled") as screen:
            (picture,) = screen.pictures()
        small, quilt = unrolled_quilt(WALL, (320, 200))
        with show.renderer(device, small) as renderer:
            frame = show.frame(small, 0.0, [replace(VIEWER, time_s=0.0)])
            panels = {each.name: each.pixels[..., :3].copy() for each in renderer.pictures(frame)}
    for name, part in pieces(small, quilt, picture).items():
        assert (np.abs(part.astype(int) - panels[name]).max(axis=-1) > 8).mean() < 0.02, name


def test_images_alone_are_unrolled_and_moved_and_all_else_is_seen_by_an_eye(layers: dict[str, Layer]) -> None:
    assert default_view(Show([layers["image"], layers["image"]])) == "unrolled"
    assert default_view(Show([layers["image"], layers["mesh"]])) == "eye"


def test_several_images_are_moved_alike(device: Any, layers: dict[str, Layer]) -> None:
    with Offscreen(device, Show([layers["image"], layers["image"]]), None, None) as screen:
        first = screen.pictures()
        screen.app.handle({"event_type": "wheel", "dy": -300.0, "x": 10.0, "y": 10.0})
        nearer = screen.pictures()
        assert (first[0] != nearer[0]).mean() > 0.2
        screen.app.handle({"event_type": "key_down", "key": "0"})
        np.testing.assert_allclose(screen.pictures()[0].astype(int), first[0], atol=1)


def test_nobody_in_the_room_is_somebody_who_stands_before_it(device: Any, layers: dict[str, Layer]) -> None:
    """A tracker that sees nobody stops no frame."""
    show = Show([layers["mesh"]], WALL)
    with Offscreen(device, show, WALL, "eye", lambda _time_s: []) as nobody:
        alone = nobody.pictures()[0]
    with Offscreen(device, show, WALL, "eye", show.stands) as somebody:
        np.testing.assert_array_equal(somebody.pictures()[0], alone)


def test_a_show_runs_offscreen_until_its_time_is_over_and_raises_what_fails() -> None:
    said: list[str] = []
    report = run_show(Show([torus_knot(2000)]), None, Viewer((0, 0, 0)), said.append, backend="offscreen", seconds=1)
    assert isinstance(report, FrameReport)
    assert "drag to turn" in said[0]

    def fails(_time_s: float) -> list[Viewer]:
        raise DeviceError("the tracker is gone")

    with pytest.raises(DeviceError, match="the tracker is gone"):
        run_show(Show([torus_knot(2000)]), None, fails, said.append, backend="offscreen", seconds=5)
    with pytest.raises(InputError, match="give Show a display"):
        Show([torus_knot(2000)]).run(view="outputs", backend="offscreen")


class Client(threading.Thread):
    """A browser without a screen: looks at some frames, drags, and presses q."""

    def __init__(self) -> None:
        super().__init__(daemon=True)
        self.pictures: list[Rgb] = []
        self.refused: list[int] = []
        self.fault: BaseException | None = None
        self._address = ""
        self._there = threading.Event()

    def say(self, text: str) -> None:
        if text.startswith("http"):
            self._address = text.split("/")[2]
            self._there.set()

    def run(self) -> None:
        self._there.wait(60)
        try:
            for headers in ({"Host": "elsewhere.example"}, {"Origin": "http://elsewhere.example"}):
                request = urllib.request.Request(f"http://{self._address}/", headers=headers)
                try:
                    urllib.request.urlopen(request)
                except urllib.error.HTTPError as error:
                    self.refused.append(error.code)
            page = urllib.request.urlopen(f"http://{self._address}/").read().decode()
            assert "<title>limen</title>" in page
            asyncio.run(self._watch())
        except BaseException as error:
            self.fault = error

    async def _watch(self) -> None:
        import websockets

        address = f"ws://{self._address}/"
        with pytest.raises(websockets.exceptions.InvalidStatus):
            async with websockets.connect(address, origin="http://elsewhere.example"):  # type: ignore[arg-type]
                pass
        async with websockets.connect(address, origin=f"http://{self._address}", max_size=None) as socket:  # type: ignore[arg-type]

            async def tell(kind: str, **more: Any) -> None:
                await socket.send(json.dumps({"type": kind, "timestamp": 0, "modifiers": [], **more}))

            await tell("resize", width=240, height=160, pwidth=240, pheight=160, ratio=1)
            head: dict[str, Any] = {}
            while len(self.pictures) < 12:
                message = await asyncio.wait_for(socket.recv(), 60)
                if isinstance(message, str):
                    head = json.loads(message)
                    continue
                self.pictures.append(np.asarray(Picture.open(io.BytesIO(message)).convert("RGB")))
                await tell("_framefeedback", index=head["index"], timestamp=head["timestamp"], localtime=0)
                if len(self.pictures) == 6:
                    await tell("pointer_down", x=100, y=80, button=1, buttons=[1])
                    await tell("pointer_move", x=220, y=80, button=0, buttons=[1])
            await tell("key_down", key="q")
            await asyncio.sleep(1)


def test_a_browser_sees_the_show_and_drags_it_and_no_other_page_does() -> None:
    for _ in range(2):  # the loop of the first has ended
        client = Client()
        client.start()
        report = run_show(Show([torus_knot(3000)]), None, Viewer((0, 0, 0)), client.say, backend="browser", seconds=90)
        client.join(30)
        if client.fault is not None:
            raise client.fault
        assert report is not None
        assert client.refused == [403, 403]
        before, after = client.pictures[5], client.pictures[-1]
        assert before.shape == (160, 240, 3)
        assert shown([before]) > 0.05
        assert (np.abs(before.astype(int) - after).max(axis=-1) > 30).mean() > 0.05, "the drag turned it"


def test_a_page_that_nobody_looks_at_ends_in_time_and_a_taken_port_is_told() -> None:
    import socket

    begin = time.monotonic()
    show, who = Show([torus_knot(2000)]), Viewer((0, 0, 0))
    assert run_show(show, None, who, str, backend="browser", seconds=0.5) is None
    assert time.monotonic() - begin < 30
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        with pytest.raises(InputError, match=f"--port {port} cannot be listened on"):
            run_show(show, None, who, str, backend="browser", seconds=1, port=port)


def test_a_page_shows_one_quilt(layers: dict[str, Layer]) -> None:
    several = replace(MAPPED, quilts=tuple(pack_outlines(MAPPED, max_px=20_000)))
    assert len(several.quilts) > 1
    with pytest.raises(InputError, match="a browser shows one picture"):
        run_show(Show([layers["mesh"]], several), several, VIEWER, str, view="outputs", backend="browser", seconds=1)


def test_a_notebooks_cell_shows_the_show_until_it_is_closed(layers: dict[str, Layer]) -> None:
    """The widget's own messages, as a notebook would send them."""
    frames: list[tuple[dict[str, Any], list[bytes]]] = []

    async def look() -> Any:
        show = Show([layers["mesh"]], WALL)
        widget = show.widget(VIEWER, view="unrolled", size_px=(300, 200))
        widget.send = lambda message, buffers=None: frames.append((message, buffers))
        size = {"width": 300, "height": 200, "pwidth": 300, "pheight": 200, "ratio": 1, "pixel_ratio": 1}
        event = {"type": "resize", "event_type": "resize", "timestamp": 0, "time_stamp": 0, **size}
        widget._rfb_handle_msg(widget, event, [])
        widget._has_visible_views = True
        while len(frames) < 8:
            await asyncio.sleep(0.05)
            if frames:
                head = frames[-1][0]
                widget._frame_feedback = {"index": head["index"], "timestamp": head["timestamp"], "localtime": 0}
        widget.close()
        await asyncio.sleep(0.3)
        return widget

    widget = asyncio.run(asyncio.wait_for(look(), 60))
    assert widget.get_closed()
    picture = np.asarray(Picture.open(io.BytesIO(frames[-1][1][0])).convert("RGB"))
    assert picture.shape == (200, 300, 3)
    assert shown([picture]) > 0.02
    with pytest.raises(InputError, match="not a notebook's cell"):
        Show([layers["mesh"]], MAPPED).widget(view="outputs")
