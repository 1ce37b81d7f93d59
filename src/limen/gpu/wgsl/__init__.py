"""Shaders that others stand on: what kinds of content share."""
