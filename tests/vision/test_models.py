"""The other models, and a person's own table."""

from __future__ import annotations

import numpy as np
import pytest

import limen
from limen.errors import FormatError, InputError, MissingFileError
from limen.vision.calibration import CalibrationTable
from limen.vision.models import MANNOS_SAKRISON_PEAK

TABLE = "# mine, 80 cd/m2\nfrequency_cpd, 0, 10\n1, 50, 20\n\n4, 100, 25\n16, 40, 1\n32, 4, 0.1\n"


def test_barten_reproduces_the_curve_of_the_itu():
    """Smallest visible contrast of a 60 degree field as drawn in Report ITU-R BT.2246, figure 31.

    The numbers are those of colour-science's issue 1022, which found the logarithm of the pupil to have base 10.
    """
    luminance = np.logspace(-2, 2, 10)[1:]  # the first lies below limen's range
    smallest = [0.014184813713158736, 0.00952448986054018, 0.006680496306613172, 0.004924641286022344,
                0.0038228778810919495, 0.003118856932347983, 0.002662754642667843, 0.002367458781369199,
                0.0021814667512135366]  # fmt: skip
    frequency = np.geomspace(0.1, 20, 4000)
    best = limen.sensitivity(frequency[:, None], 0, luminance, area_deg2=60**2, model="barten").max(axis=0)
    np.testing.assert_allclose(2 / 1.27 / best, smallest, rtol=1e-5)


def test_mannos_sakrison_peaks_at_eight_cycles_a_degree():
    frequency = np.geomspace(0.1, 60, 20_000)
    found = limen.sensitivity(frequency, model="mannos-sakrison")
    assert found.max() == pytest.approx(MANNOS_SAKRISON_PEAK, rel=1e-5)
    assert frequency[found.argmax()] == pytest.approx(7.89, abs=0.01)
    assert found.max() == pytest.approx(limen.sensitivity(frequency).max(), rel=1e-3)
    plain = 2.6 * (0.0192 + 0.114 * 20) * np.exp(-((0.114 * 20) ** 1.1))
    assert limen.sensitivity(20, model="mannos-sakrison") / found.max() == pytest.approx(plain / 0.980878, rel=1e-5)


@pytest.fixture
def table(tmp_path):
    (tmp_path / "me.csv").write_text(TABLE)
    return CalibrationTable.load(tmp_path / "me.csv")


def test_a_table_is_bilinear_and_clamped(table):
    def ask(frequency, eccentricity=0.0):
        return limen.sensitivity(frequency, eccentricity, model=table)

    np.testing.assert_allclose(ask([4, 16, 32], 0), [100, 40, 4])
    np.testing.assert_allclose(ask([4, 16, 32], 10), [25, 1, 0.1])
    assert ask(8) == pytest.approx(np.sqrt(100 * 40)), "half way in log frequency is half way in log sensitivity"
    assert ask(16, 5) == pytest.approx(np.sqrt(40 * 1))
    np.testing.assert_allclose(ask([0.1, 1, 3]), 100), "below the peak, the peak"
    assert ask(500) == 4
    assert ask(16, 80) == ask(16, 10)
    assert ask(8, 3).shape == ()
    assert limen.sensitivity([[1], [2]], [0, 5, 10], model=table).shape == (2, 3)
    assert limen.sensitivity(8, 0, 1, 5, 9, model=table) == ask(8), "as it was measured"


def test_what_a_table_sees_ends_with_its_last_frequency(table):
    seen = limen.visible_cpd([1, 0.5, 1 / 40, 1 / 63.2455, 0.0101, 0.001], model=table, floor="none")
    np.testing.assert_allclose(seen[:4], [32, 32, 16, 8], rtol=1e-4)
    assert seen[4] == pytest.approx(4.0, rel=0.05)
    assert seen[5] == 0
    assert limen.visible_cpd(1, model=table) == pytest.approx(48.6, abs=0.1), "people resolve more, at contrast 1"


def test_a_table_of_one_eccentricity_holds_everywhere():
    flat = CalibrationTable((1.0, 10.0), (0.0,), ((100.0,), (10.0,)))
    assert limen.sensitivity(np.sqrt(10), 40, model=flat) == pytest.approx(np.sqrt(1000))


@pytest.mark.parametrize(
    ("old", "new", "line", "words"),
    [
        ("4, 100, 25", "4, 100,", 5, "column 10 is empty"),
        ("4, 100, 25", "4, 100", 5, "2 cells for 3 columns"),
        ("4, 100, 25", "4, nan, 25", 5, "sensitivity at 0 degrees must be above 0, got nan"),
        ("4, 100, 25", "4, 100, -25", 5, "sensitivity at 10 degrees must be above 0, got -25"),
        ("4, 100, 25", "4, x, 25", 5, "column 0 is 'x', which is not a number"),
        ("16, 40, 1", "4, 40, 1", 6, "must rise from above 0, got 4 after 4; sort the lines"),
        ("1, 50, 20", "0, 50, 20", 3, "must rise from above 0, got 0"),
        ("frequency_cpd, 0, 10", "frequency_cpd, 10, 0", 2, "eccentricities must rise"),
        ("frequency_cpd, 0, 10", "frequency_cpd, 0, nan", 2, "eccentricities must rise"),
        ("frequency_cpd, 0, 10", "cpd, 0, 10", 2, "not a calibration table"),
    ],
)
def test_a_broken_table_is_named_with_line_and_field(tmp_path, old, new, line, words):
    path = tmp_path / "me.csv"
    path.write_text(TABLE.replace(old, new))
    with pytest.raises(FormatError) as caught:
        CalibrationTable.load(path)
    assert f"me.csv:{line}: " in str(caught.value)
    assert words in str(caught.value)


def test_files_that_are_no_tables(tmp_path):
    with pytest.raises(MissingFileError, match=r"none\.csv"):
        CalibrationTable.load(tmp_path / "none.csv")
    (tmp_path / "me.csv").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(FormatError, match="text file"):
        CalibrationTable.load(tmp_path / "me.csv")
    (tmp_path / "me.csv").write_text("frequency_cpd,0\n")
    with pytest.raises(FormatError, match="fewer than two lines"):
        CalibrationTable.load(tmp_path / "me.csv")
    with pytest.raises(InputError, match="row 2: 1 sensitivities for 2"):
        CalibrationTable((1.0, 2.0), (0.0, 5.0), ((3.0, 2.0), (1.0,)))
