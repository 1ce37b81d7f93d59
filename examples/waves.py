"""A mesh made of NumPy arrays for every frame, before a picture of the world: two layers, in a loop of one's own."""

from dataclasses import replace

import numpy as np

import limen
from limen.data import sample_image
from limen.data.mesh.mesh import NO_TEXTURE, Mesh

sample_image("world.tif", 0.01, aspect=1.6)

side = np.linspace(-1, 1, 81)
x, z = np.meshgrid(side, side)
corner = np.arange(80 * 81).reshape(80, 81)[:, :-1].ravel()
faces = np.concatenate(
    [np.stack([corner, corner + 81, corner + 1], 1), np.stack([corner + 1, corner + 81, corner + 82], 1)]
)


def water(time_s: float) -> Mesh:
    """A sheet of water, whose waves run along x."""
    phase = 6 * x - 3 * time_s
    places = np.stack([x, 0.08 * np.sin(phase), z], axis=-1).reshape(-1, 3).astype(np.float32)
    normals = np.stack([-0.48 * np.cos(phase), np.ones_like(x), np.zeros_like(x)], axis=-1).reshape(-1, 3)
    normals = (normals / np.linalg.norm(normals, axis=1, keepdims=True)).astype(np.float32)
    return replace(still, positions=places, normals=normals)


count = x.size
still = Mesh(
    None, np.zeros((count, 3), np.float32), faces.astype(np.uint32), np.tile(np.float32([0, 1, 0]), (count, 1)),
    np.tile(np.uint8([60, 140, 200, 255]), (count, 1)), np.zeros((count, 2), np.float32),
    np.full(count, NO_TEXTURE, np.uint32), np.zeros((0, 1, 1, 4), np.uint8),
)  # fmt: skip
wall = limen.Display.named("rostock").scaled(0.1)
stands = limen.RoomPlacement(size_m=4.0, at_m=(0.0, 0.9, -2.0), tilt_deg=15.0)
sea = limen.MeshLayer(water(0.0), stands, deformed=water)
visitor = limen.Viewer((0.0, 1.7, 2.0))

with (
    limen.Show(["world.tif", sea], wall) as show,
    limen.open_device() as device,
    show.renderer(device, wall) as renderer,
):
    for time_s in (0.0, 0.5, 1.0):
        report = renderer.frame(show.frame(wall, time_s, [visitor]))
        print(f"{time_s:.1f} s:", *(f"{row.name} {row.draw_ms:.1f} ms" for row in report.layers))
