"""A mesh seen through a display of 1,024 panels in the shape of a teapot, and what that looks like from elsewhere."""

import limen
from limen.data import torus_knot
from limen.frame.renderer import Renderer
from limen.gpu.device import open_device
from limen.layers.mesh.layer import MeshLayer
from limen.pictures.files import write_picture
from limen.viewing.camera import Camera

teapot = limen.Display.preset("teapot").scaled(0.2)  # a fifth of the pixels: enough for a look
viewer = limen.Viewer((0.5, 1.6, 2.0), direction=(-0.2, -0.2, -1))
eye = Camera(viewer.position_m, (0, 1.2, 0), size_px=(640, 480))
friend = Camera((-1.2, 1.6, 1.8), (0, 1.2, 0), size_px=(640, 480))

with open_device() as device, Renderer(device, teapot, [MeshLayer(torus_knot(20_000))]) as renderer:
    frame = renderer.state(time_s=0.0, viewers=(viewer,))
    for name, picture in zip(("viewer", "friend"), renderer.seen(frame, [eye, friend]), strict=True):
        print(write_picture(f"{name}.jpg", picture))
