"""Where an image has detail that eyes could see: its pages, from blue (the finer level adds nothing) to yellow."""

import sys

import matplotlib
import numpy as np

import limen
from limen.data import CONTRAST_OF_BYTE, PAGE, page_contrast, sample_image
from limen.pictures.files import write_picture

path = sys.argv[1] if len(sys.argv) > 1 else sample_image("world.tif", gigapixels=0.01, aspect=2.0).path
number = int(sys.argv[2]) if len(sys.argv) > 2 else 1
with limen.open(path) as image:
    level, found = image.pyramid.levels[number], page_contrast(image)
    rows = [[image.read_page((number, x, y), gutter=0) for x in range(level.columns)] for y in range(level.rows)]
picture = np.vstack([np.hstack(row) for row in rows])[: level.size_px[1], : level.size_px[0], :3]
picture = picture[::4, ::4]

bytes_of_level = found[level.first_page :][: level.page_count].reshape(level.rows, level.columns)
tint = matplotlib.colormaps["viridis"](bytes_of_level)[..., :3].repeat(PAGE // 4, axis=0).repeat(PAGE // 4, axis=1)
grey = picture.mean(axis=2, keepdims=True) / 255
mixed = 255 * (0.65 * tint[: picture.shape[0], : picture.shape[1]] + 0.35 * grey)

print(write_picture("contrast.jpg", mixed.astype(np.uint8)))
print("contrast of half of the pages is at most", CONTRAST_OF_BYTE[int(np.median(bytes_of_level))].round(3))
