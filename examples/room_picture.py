"""A picture of a whole room that shows an image, as seen from outside: for a talk, or to plan an installation."""

import limen
from limen.data import sample_image
from limen.pictures.files import write_picture
from limen.pictures.room import draw_room, draw_surface

sample_image("world.tif", gigapixels=0.01)
room = limen.Display.preset("reality-deck")
visitors = [limen.Viewer((-2.0, 1.7, -1.0), direction=(-1, 0, -1)), limen.Viewer((2.5, 1.6, 1.0), direction=(1, 0, 0))]

# A fortieth of the pixels of each panel is enough for a picture of all 416.
pictures = limen.render("world.tif", room, visitors, scale=1 / 40)

print(write_picture("room.jpg", draw_room(room, pictures=pictures, viewers=visitors)))
print(write_picture("unrolled.jpg", draw_surface(room, pictures)))
