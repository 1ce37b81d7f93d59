"""The page that a canvas appears on in the browser, served to this machine alone."""

from __future__ import annotations

import asyncio
import contextlib
import signal
import socket
from collections.abc import Callable, Iterator
from typing import Any
from urllib.parse import urlsplit

from limen.errors import InputError

__all__ = ["serve"]

_HERE = ("localhost", "127.0.0.1")
_LOOKED_AT_S = 0.1
_SIGNALS = (signal.SIGINT, signal.SIGTERM)
_PAGE = """<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>limen</title>
<link rel="stylesheet" href="renderview.css">
<style>
  html, body { margin: 0; height: 100%; overflow: hidden; background: #111; color: #ccc; font: 14px sans-serif }
  #canvas { border: 0 }
  #canvas > p { margin: 0; padding: 2em }
  #status { position: fixed; right: 0; bottom: 0; padding: .3em .6em; background: #111a }
</style>
<script type="module" src="renderview.js"></script>
<script type="module" src="renderview-client.js"></script>
</head>
<body>
<div id="canvas" class="renderview-wrapper" style="width: 100vw; height: 100vh">
  <p>Waiting for the first frame ...</p>
</div>
<div id="status"></div>
</body>
</html>
"""


def serve(over: Callable[[], bool], port: int, say: Callable[[str], None]) -> None:
    """Serve the page until it is ``over``, or until Ctrl-C.

    Parameters
    ----------
    port
        0 takes a free one; ``say`` is told the address.

    Raises
    ------
    InputError
        If another program listens on this port.
    """
    import uvicorn
    from rendercanvas.http import asgi, resources

    resources["index.html"] = ("text/html", _PAGE)
    try:
        listening = socket.create_server((_HERE[1], port))
    except OSError as error:
        raise InputError(f"--port {port} cannot be listened on ({error.strerror}): give another one") from None
    with listening, _signals_kept():
        config = uvicorn.Config(
            _for_this_machine(asgi), log_level="warning", timeout_graceful_shutdown=1, ws_max_size=1 << 20
        )
        server = uvicorn.Server(config)
        say(f"http://localhost:{listening.getsockname()[1]}/ in a browser on this machine; Ctrl-C ends it")
        asyncio.run(_until(over, server, listening))


async def _until(over: Callable[[], bool], server: Any, listening: socket.socket) -> None:
    serving = asyncio.create_task(server.serve(sockets=[listening]))
    while not serving.done():
        if server.started:  # rendercanvas' loop took the signals then, and would close under its clients
            _end_by_signals(server)
        server.should_exit = server.should_exit or over()
        await asyncio.sleep(_LOOKED_AT_S)
    await serving


def _end_by_signals(server: Any) -> None:
    with contextlib.suppress(ValueError):  # of another thread than the main one
        for number in _SIGNALS:
            signal.signal(number, server.handle_exit)


@contextlib.contextmanager
def _signals_kept() -> Iterator[None]:
    """What signals did before, they do afterwards."""
    before = {number: signal.getsignal(number) for number in _SIGNALS}
    try:
        yield
    finally:
        with contextlib.suppress(ValueError):
            for number, handler in before.items():
                signal.signal(number, handler)


def _for_this_machine(app: Any) -> Any:
    """The same server for its own page alone: no other site that is open in the browser may look on, or press keys."""

    async def checked(scope: Any, receive: Any, send: Any) -> None:
        if scope["type"] in ("http", "websocket"):
            headers = {name: value.decode("latin-1") for name, value in scope["headers"]}
            host = headers.get(b"host", "")
            origin = headers.get(b"origin")
            foreign = origin is not None and urlsplit(origin).netloc != host
            if foreign or urlsplit(f"//{host}").hostname not in _HERE:
                if scope["type"] == "websocket":
                    await send({"type": "websocket.close", "code": 1008})
                    return
                await send({"type": "http.response.start", "status": 403, "headers": []})
                await send({"type": "http.response.body", "body": b"only for http://localhost"})
                return
        await app(scope, receive, send)

    return checked
