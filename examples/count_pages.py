"""How many pages a frame needs when a visitor walks up to a wall: the decisions without any drawing."""

import limen
from limen.data.pages import Pyramid
from limen.layers.image.select import select, view_of
from limen.viewing.placement import OnSurface
from limen.viewing.policy import Policy
from limen.viewing.tolerance import tolerance_of

wall = limen.Display.preset("rostock")
# A virtual image of 160 gigapixels, fitted to the wall: no file is needed to decide.
view = view_of(wall, Pyramid.of((512_000, 320_000)), OnSurface("cover"))

print("distance   full   acuity 1'   acuity 0.64'")
for distance_m in (5.0, 3.0, 2.0, 1.0, 0.5, 0.25):
    viewer = limen.Viewer(position_m=(0, 1.5, -1.5 + distance_m))
    counts = [
        len(select(view, tolerance_of([viewer], policy)))
        for policy in (Policy("full"), Policy("acuity", 1.0), Policy("acuity", 0.64))
    ]
    print(f"{distance_m:6.2f} m  {counts[0]:5d}  {counts[1]:9d}  {counts[2]:12d}")
