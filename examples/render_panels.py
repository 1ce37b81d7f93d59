"""Draw what two panels of the Reality Deck show to a visitor, and save the pictures."""

from pathlib import Path

import limen
from limen.data import sample_image
from limen.pictures.files import write_picture

sample_image("world.tif", gigapixels=0.01)
wall = limen.Display.preset("reality-deck")
visitor = limen.Viewer(position_m=(1.0, 1.7, -2.2), direction=(0, 0, -1))

pictures = limen.render("world.tif", wall, [visitor], policy="acuity", panels=["front/9,3", "left/4,3"])

for name, picture in pictures.items():
    path = write_picture(Path(f"{name.replace('/', '-')}.jpg"), picture)
    print(f"{name}: {picture.shape[1]} x {picture.shape[0]} pixels, {path}")
