"""Magnify two places of an image in place, on a wall of 24 panels, and save one panel's picture."""

from pathlib import Path

import limen
from limen.data import sample_image
from limen.pictures.files import write_picture
from limen.viewing.placement import OnSurface

sample_image("world.tif", gigapixels=0.004)
wall = limen.Display.preset("rostock")
visitor = limen.Viewer(position_m=(0.0, 1.7, 1.5))

with limen.open("world.tif") as image:
    width, height = image.size_px
    large = limen.Lens((width / 2, height / 2), radius_px=height / 4, magnification=6)
    flat = limen.Lens((width * 0.6, height * 0.4), (height / 5, height / 8), magnification=2, shape="rectangular")
    placement = OnSurface("cover", lenses=(large, flat))
    pictures = limen.render(image, wall, [visitor], panels="wall/2,3", placement=placement, scale=0.25)

for name, picture in pictures.items():
    print(write_picture(Path(f"{name.replace('/', '-')}.jpg"), picture))
