"""A person's own contrast sensitivity, measured, as a table."""

from __future__ import annotations

import csv
import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from limen.errors import FormatError, InputError, MissingFileError
from limen.geometry import Floats

__all__ = ["CalibrationTable", "read_table"]

_EXAMPLE = "frequency_cpd,0,10,20 (eccentricities in degrees) and a line a frequency below it"


@dataclass(frozen=True, slots=True)
class CalibrationTable:
    """Sensitivity measured at some frequencies and eccentricities.

    Between them it is bilinear in log frequency, eccentricity and log sensitivity. Below the peak of an eccentricity
    the peak's value is used (a coarse pattern is never less visible than a fine one), and beyond the ends the ends'.
    Luminance, flicker and area are those of the measurement.

    Parameters
    ----------
    frequency_cpd
        Rising, above 0; at least two.
    eccentricity_deg
        Rising, 0 or more; at least one.
    sensitivity
        One over the smallest visible contrast: a row a frequency, a column an eccentricity; above 0.

    Raises
    ------
    InputError
        If an axis does not rise or a value is not a positive number; the message names the row and the column.
    """

    frequency_cpd: tuple[float, ...]
    eccentricity_deg: tuple[float, ...]
    sensitivity: tuple[tuple[float, ...], ...]

    def __post_init__(self) -> None:
        if fault := _fault(self.frequency_cpd, self.eccentricity_deg, self.sensitivity):
            raise InputError(f"calibration table, row {fault[0]}: {fault[1]}")

    @classmethod
    def load(cls, path: str | Path) -> CalibrationTable:
        """Read a table: ``frequency_cpd,0,10,20`` first, then a frequency and its sensitivities a line; ``#`` comments.

        Raises
        ------
        MissingFileError
            If the file does not exist.
        FormatError
            If it holds no table, or a hole, or a number that cannot be; the message names line and field.
        """
        path = Path(path)
        lines, rows = read_table(path, f"its first line should look like {_EXAMPLE}")
        header = rows[0]
        if header[0] != "frequency_cpd" or len(header) < 2:
            raise FormatError(f"{path}:{lines[0]}: not a calibration table; the first line should look like {_EXAMPLE}")
        eccentricities = tuple(_number(path, lines[0], "eccentricity", cell) for cell in header[1:])
        numbers = []
        for line, row in zip(lines[1:], rows[1:], strict=True):
            if len(row) != len(header):
                raise FormatError(f"{path}:{line}: {len(row)} cells for {len(header)} columns; a hole must be measured")
            numbers.append([_number(path, line, name, cell) for name, cell in zip(header, row, strict=True)])
        axes = tuple(row[0] for row in numbers), eccentricities
        table = tuple(tuple(row[1:]) for row in numbers)
        if fault := _fault(*axes, table):
            raise FormatError(f"{path}:{lines[fault[0]]}: {fault[1]}")
        return cls(*axes, table)

    def log_sensitivity(
        self, frequency: Floats, eccentricity: Floats, light: Floats, temporal_hz: Floats, area_deg2: Floats
    ) -> Floats:
        """``log10 S``; the arguments broadcast, and the last three change nothing."""
        table = np.log10(np.array(self.sensitivity))
        table = np.maximum.accumulate(table[::-1])[::-1]  # below the peak, the peak
        row, up = _place(np.log(np.maximum(frequency, 1e-9)), np.log(np.array(self.frequency_cpd)))
        column, along = _place(eccentricity, np.array(self.eccentricity_deg))
        right = np.minimum(column + 1, table.shape[1] - 1)
        here = table[row, column] * (1 - along) + table[row, right] * along
        above = table[row + 1, column] * (1 - along) + table[row + 1, right] * along
        return np.asarray(here * (1 - up) + above * up + 0 * (light + temporal_hz + area_deg2))


def read_table(path: Path, advice: str) -> tuple[list[int], list[list[str]]]:
    """Line numbers and stripped cells of a CSV file without its comments and empty lines; at least two lines.

    Raises
    ------
    MissingFileError, FormatError
        If there is no such file, it is not text, or less than two lines are left; ``advice`` ends the message.
    """
    try:
        text = path.read_text(encoding="utf-8-sig")
    except FileNotFoundError:
        raise MissingFileError(f"{path}: no such table") from None
    except (OSError, UnicodeDecodeError) as error:
        raise FormatError(f"{path}: cannot be read as a text file: {error}") from None
    kept = [(n, line) for n, line in enumerate(text.splitlines(), 1) if line.strip() and not line.startswith("#")]
    if len(kept) < 2:
        raise FormatError(f"{path}: fewer than two lines; {advice}")
    return [n for n, _ in kept], [[cell.strip() for cell in next(csv.reader([line]))] for _, line in kept]


def _number(path: Path, line: int, name: str, cell: str) -> float:
    try:
        return float(cell)
    except ValueError:
        what = "is empty; a hole must be measured" if not cell else f"is '{cell}', which is not a number"
        raise FormatError(f"{path}:{line}: column {name} {what}") from None


def _fault(
    frequencies: tuple[float, ...], eccentricities: tuple[float, ...], table: tuple[tuple[float, ...], ...]
) -> tuple[int, str] | None:
    """The row (0 is that of the eccentricities) and what is wrong with it."""
    if len(frequencies) < 2 or not eccentricities:
        return 0, f"it needs at least two frequencies and one eccentricity, like {_EXAMPLE}"
    if not _rises(eccentricities, 0.0):
        return 0, f"eccentricities must rise from 0 or more, got {list(eccentricities)}; sort the columns"
    if len(table) != len(frequencies):
        return 0, f"{len(table)} rows of sensitivity for {len(frequencies)} frequencies"
    for row, values in enumerate(table, 1):
        frequency, before = frequencies[row - 1], frequencies[row - 2] if row > 1 else 0.0
        if not (math.isfinite(frequency) and frequency > before):
            return row, f"frequency_cpd must rise from above 0, got {frequency:g} after {before:g}; sort the lines"
        if len(values) != len(eccentricities):
            return row, f"{len(values)} sensitivities for {len(eccentricities)} eccentricities"
        for value, eccentricity in zip(values, eccentricities, strict=True):
            if not (math.isfinite(value) and value > 0):
                cure = "where nothing was visible, write a number below 1, like 0.1"
                return row, f"sensitivity at {eccentricity:g} degrees must be above 0, got {value:g}; {cure}"
    return None


def _rises(values: tuple[float, ...], least: float) -> bool:
    return all(math.isfinite(v) for v in values) and values[0] >= least and all(np.diff(values) > 0)


def _place(values: Floats, axis: Floats) -> tuple[NDArray[np.int64], Floats]:
    """Index of the cell and the place in it, 0 ... 1, clamped to the axis."""
    if len(axis) == 1:
        return np.zeros(np.shape(values), np.int64), np.zeros(np.shape(values))
    cell = np.clip(np.searchsorted(axis, values, side="right") - 1, 0, len(axis) - 2)
    return cell, np.clip((values - axis[cell]) / (axis[cell + 1] - axis[cell]), 0.0, 1.0)
