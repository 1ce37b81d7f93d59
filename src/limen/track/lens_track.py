"""Lenses that move, grow and magnify over time: an animation, or what somebody did with them, as a file."""

from __future__ import annotations

import csv
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from limen.errors import FormatError, InputError, MissingFileError
from limen.geometry import Floats
from limen.viewing.lens import Lens

__all__ = ["COLUMNS", "LensTrack", "lenses_at", "read_lens_tracks"]

COLUMNS = ("time_s", "x_px", "y_px", "radius_px", "magnification")
"""Of the file; ``lens``, which tells lenses apart, may be left out where there is one."""


@dataclass(frozen=True, slots=True, eq=False)
class LensTrack:
    """One lens over time.

    Parameters
    ----------
    style
        All of the lens that stays as it is.
    time_s
        Shape (N,), growing.
    centre_px
        Shape (N, 2), texels.
    radius_px, magnification
        Shape (N,).
    """

    style: Lens
    time_s: Floats
    centre_px: Floats
    radius_px: Floats
    magnification: Floats

    def at(self, time_s: float) -> Lens:
        """The lens at a time: between samples its place changes evenly, its size and power by even factors; before the
        first and after the last it is as there.
        """
        x, y = (float(np.interp(time_s, self.time_s, axis)) for axis in self.centre_px.T)
        radius_px, magnification = (
            math.exp(np.interp(time_s, self.time_s, np.log(values))) for values in (self.radius_px, self.magnification)
        )
        return replace(self.style, centre_px=(x, y), radius_px=radius_px, magnification=max(magnification, 1.0))


class _Sample(NamedTuple):
    time_s: float
    lens: Lens


def lenses_at(tracks: Sequence[LensTrack], time_s: float) -> tuple[Lens, ...]:
    """All lenses at a time; one that magnifies nothing then is left out."""
    lenses = (track.at(time_s) for track in tracks)
    return tuple(lens for lens in lenses if lens.magnification > 1)


def read_lens_tracks(path: Path, style: Lens) -> tuple[LensTrack, ...]:
    """The lenses of a file of comma-separated values with `COLUMNS`, in the order in which they first appear.

    Parameters
    ----------
    style
        A lens whose focus, drop-off and outline all have.

    Raises
    ------
    FormatError
        If a line cannot be used; the message names it and the field.
    MissingFileError
        If there is no such file.
    """
    samples: dict[str, list[_Sample]] = {}
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            reader = csv.DictReader(line for line in file if not line.startswith("#"))
            missing = [name for name in COLUMNS if name not in (reader.fieldnames or ())]
            if missing:
                raise FormatError(
                    f"{path}: no column {', '.join(missing)}: give {', '.join(COLUMNS)}, and lens if several"
                )
            for number, row in enumerate(reader, 1):
                here = samples.setdefault(row.get("lens") or "", [])
                here.append(_sample(f"{path}: sample {number}", row, style, here))
    except OSError:
        raise MissingFileError(f"{path}: cannot be read: is it there?") from None
    except UnicodeDecodeError:
        raise FormatError(f"{path}: is not text in UTF-8") from None
    if not samples:
        raise FormatError(f"{path}: no lens in it: give a line for each time")
    return tuple(_track_of(style, each) for each in samples.values())


def _sample(where: str, row: dict[str, str], style: Lens, before: Sequence[_Sample]) -> _Sample:
    values = {}
    for name in COLUMNS:
        try:
            values[name] = float(row[name])
        except (TypeError, ValueError):
            raise FormatError(f"{where}: {name} is no number: '{row[name] or ''}'") from None
    if not math.isfinite(values["time_s"]):
        raise FormatError(f"{where}: time_s is not finite: drop the sample")
    if before and values["time_s"] <= before[-1].time_s:
        raise FormatError(f"{where}: time_s does not grow: sort a lens's samples by time and drop repeats")
    centre_px = (values["x_px"], values["y_px"])
    try:
        lens = replace(style, centre_px=centre_px, radius_px=values["radius_px"], magnification=values["magnification"])
    except InputError as error:
        raise FormatError(f"{where}: {error}") from None
    return _Sample(values["time_s"], lens)


def _track_of(style: Lens, samples: Sequence[_Sample]) -> LensTrack:
    return LensTrack(
        style,
        np.array([sample.time_s for sample in samples]),
        np.array([sample.lens.centre_px for sample in samples]),
        np.array([sample.lens.radii_px[0] for sample in samples]),
        np.array([sample.lens.magnification for sample in samples]),
    )
