"""Describe a display in a file, check it, and see where its pixels stop being seen."""

from pathlib import Path

import limen

wall = limen.Display.load(Path(__file__).with_name("wall.toml"))
panel = wall.panels[0]
print(f"{wall.name}: {len(wall.panels)} panels, {wall.total_px / 1e6:.1f} megapixels, {len(wall.nodes)} machines")
for acuity_arcmin in (1.0, 0.64):
    distance_m = limen.optimal_distance_m(panel.pitch_m[0], acuity_arcmin)
    print(f"a pixel subtends {acuity_arcmin} arcminutes at {distance_m:.2f} m")
