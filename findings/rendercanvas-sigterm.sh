#!/bin/sh
# rendercanvas 2.7.2: after a loop has run, the program's own SIGTERM handler has been replaced for good.
#
# A program sets its own handlers for SIGINT and SIGTERM, runs a loop of `rendercanvas.asyncio` that a task of its own
# stops, and asks who handles the signals. One would expect the loop to handle both while it runs, and the program
# afterwards, for the loop puts back what it found. Seen instead: afterwards SIGINT is as it was, and SIGTERM is handled
# by the loop's function from then on: the program's is never called when somebody ends it by `kill`. While the loop runs it is the other way round: the loop installs its function for SIGINT
# twice, and for SIGTERM not at all.
#
#   while it runs: SIGINT the loop's, SIGTERM the program's; afterwards: SIGINT the program's, SIGTERM the loop's
#
# Exit code: 0 where it is still so, 1 where SIGTERM is handled by the program again after the loop.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet --disable-pip-version-check rendercanvas==2.7.2 numpy==2.2.6
cat > "$folder/signals.py" <<'END'
import signal

from rendercanvas.asyncio import loop


def own(number, frame):
    """The program's handler of both signals."""


def owners():
    return [
        "the program's" if signal.getsignal(number) is own else "the loop's"
        for number in (signal.SIGINT, signal.SIGTERM)
    ]


for number in (signal.SIGINT, signal.SIGTERM):
    signal.signal(number, own)
running = []


async def look():
    running.extend(owners())
    loop.stop()


loop.add_task(look)
loop.run()
told = "; ".join(
    f"{when}: SIGINT {first}, SIGTERM {second}"
    for when, (first, second) in (("while it runs", running), ("afterwards", owners()))
)
print(told)
raise SystemExit((running, owners()) != (["the loop's", "the program's"], ["the program's", "the loop's"]))
END
"$folder/venv/bin/python" "$folder/signals.py"
