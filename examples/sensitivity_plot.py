"""What an eye sees: contrast sensitivity, and the finest visible detail away from the gaze, as one picture."""

import matplotlib

matplotlib.use("Agg")
import numpy as np
from matplotlib import pyplot

import limen

SHADES, QUIET = ["#0b3c5d", "#1f78b4", "#2a9d8f", "#d9820b"], "#555555"

pyplot.rcParams.update({"font.size": 10.5, "axes.spines.top": False, "axes.spines.right": False})
figure, (left, right) = pyplot.subplots(1, 2, figsize=(10.5, 4.4), dpi=110, layout="constrained")

frequency_cpd = np.geomspace(0.25, 64, 300)
for eccentricity_deg, shade in zip((0, 5, 10, 20), SHADES, strict=True):
    seen = limen.sensitivity(frequency_cpd, eccentricity_deg)
    left.loglog(frequency_cpd, seen, color=shade, lw=2)
    text = f"{eccentricity_deg}°" if eccentricity_deg else "0° from the gaze"
    place = (frequency_cpd[seen.argmax()], seen.max() * 1.1)
    left.annotate(text, place, color=shade, ha="center", weight="bold")
left.set(xlim=(0.25, 64), ylim=(1, 300), xlabel="cycles a degree", ylabel="1 / smallest visible contrast")
left.set_xticks([0.25, 0.5, 1, 2, 4, 8, 16, 32, 64], ["¼", "½", "1", "2", "4", "8", "16", "32", "64"])
left.set_yticks([1, 3, 10, 30, 100, 300], ["1", "3", "10", "30", "100", "300"])
left.minorticks_off()
left.set_title("Contrast sensitivity at 100 cd/m²", loc="left")

eccentricity_deg = np.linspace(0, 30, 241)
for contrast, shade in zip((1, 0.3, 0.1, 0.03), SHADES, strict=True):
    finest = limen.visible_cpd(contrast, eccentricity_deg)
    right.semilogy(eccentricity_deg, finest, color=shade, lw=2)
    right.text(30.5, finest[-1], f"contrast {contrast:g}", color=shade, weight="bold", va="center")
right.semilogy(eccentricity_deg, limen.resolution_cpd(eccentricity_deg), color=QUIET, lw=1.5, ls=(0, (2, 2)))
line = {"arrowstyle": "-", "color": QUIET, "lw": 0.8}
right.annotate("what 18 people resolved", (0.7, limen.resolution_cpd(0.7)), (4.5, 46), color=QUIET, arrowprops=line)
right.set(xlim=(0, 30), ylim=(2, 72), xlabel="degrees from the gaze", ylabel="cycles a degree")
right.set_yticks([2, 4, 8, 16, 32, 64], ["2", "4", "8", "16", "32", "64"])
right.minorticks_off()
right.set_title("The finest detail that is visible", loc="left")

figure.savefig("sensitivity.png")
print("sensitivity.png")
