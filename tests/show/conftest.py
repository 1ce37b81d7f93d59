"""Small contents of every kind."""

from support.contents import kind, knot, layer, layers, terrain, world

__all__ = ["kind", "knot", "layer", "layers", "terrain", "world"]
