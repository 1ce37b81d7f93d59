#!/bin/sh
# rendercanvas 2.7.2 with anywidget 0.11.0: closing the notebook widget from Python ends in a RecursionError.
#
# A canvas of `rendercanvas.anywidget` is made outside any notebook and closed by its own method, as a program does that
# is done with it. One would expect a closed canvas, as the offscreen and the jupyter-rfb canvases are after `close()`.
# Seen instead: RecursionError, for closing tells the canvas that it was closed in the page, which closes it again before
# it is marked as closed; `get_closed()` is False afterwards. The canvas of `rendercanvas.jupyter` (jupyter-rfb 1.0.2) is
# closed without an error.
#
#   anywidget: RecursionError, closed False; jupyter: no error, closed True
#
# Exit code: 0 where it is still so, 1 where the anywidget canvas closes.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet --disable-pip-version-check rendercanvas==2.7.2 anywidget==0.11.0 \
    jupyter-rfb==1.0.2 numpy==2.2.6
cat > "$folder/closing.py" <<'END'
import asyncio
import importlib


async def closed(module):
    """What closing a canvas of this backend raises, and whether it says that it is closed."""
    canvas = importlib.import_module(f"rendercanvas.{module}").RenderCanvas(size=(64, 64))
    try:
        canvas.close()
    except RecursionError as error:
        return type(error).__name__, canvas.get_closed()
    return "no error", canvas.get_closed()


found = {module: asyncio.run(closed(module)) for module in ("anywidget", "jupyter")}
print("; ".join(f"{module}: {error}, closed {is_closed}" for module, (error, is_closed) in found.items()))
raise SystemExit(found != {"anywidget": ("RecursionError", False), "jupyter": ("no error", True)})
END
"$folder/venv/bin/python" "$folder/closing.py" 2>/dev/null
