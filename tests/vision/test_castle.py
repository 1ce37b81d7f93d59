"""castleCSF's colours: against a second implementation straight from the formulae, and against people's eyes."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import limen
from limen.errors import InputError
from limen.vision import castle_csf as castle
from limen.vision.contrast import D65_LMS, cone_sensitivity

# Published in the authors' code: gain, its half luminance and power; peak, bandwidth; A0, f0; k0, k1 nasal and
# temporal; power and spread of time.
RED_GREEN = (681.434, 38.0038, 0.480386, 0.0178364, 2.42104, 2816.44, 0.0711058,
             (2.89615e-05, 0.18108), (0.0591402, 2.04986e-69), 1.15591, 16.4325)  # fmt: skip
YELLOW_VIOLET = (166.683, 62.8974, 0.41193, 0.00425753, 2.68197, 2.82789e7, 0.000635093,
                 (5.85804e-141, 0.0110662), (0.00356865, 0.00806631), 0.969123, 7.15012)  # fmt: skip


def plain(constants, rho, ecc, light, omega, area, field):
    """The paper's equations one after the other, for one grating; limen's constants and code are not used."""
    most, half, power, peak, bandwidth, a0, f0, nasal, temporal, beta, sigma = constants
    s_max = most * (1 + half / light) ** -power
    distance = np.log10(rho) - np.log10(peak)
    parabola = 1.0 if rho < peak else 10 ** (-(distance**2) / 2**bandwidth)
    a_c = a0 / (1 + (rho / f0) ** 2)
    summed = np.sqrt(a_c / (1 + a_c / area)) * rho
    k0, k1 = nasal if field == "nasal" else temporal
    return s_max * parabola * summed * np.exp(-(omega**beta) / sigma) * 10 ** (-(k0 + k1 * rho) * ecc)


@given(
    st.floats(1 / 16, 64), st.floats(0, 30), st.floats(0.0113, 1e4), st.floats(0, 20), st.floats(0.01, 100),
    st.sampled_from(castle.FIELDS),
)  # fmt: skip
def test_the_colours_are_the_papers_formulae(rho, ecc, light, omega, area, field):
    for constants, name in ((RED_GREEN, "red-green"), (YELLOW_VIOLET, "yellow-violet")):
        found = limen.sensitivity(rho, ecc, light, omega, area, field, mechanism=name)
        np.testing.assert_allclose(found, plain(constants, rho, ecc, light, omega, area, field), rtol=1e-9)


COLORFEST_LMS = (27.4744764134073, 12.5255235865927, 0.955148484552597)
MEASURED = {
    "red-green": (
        (0.0516190779, -0.0437451305, -0.000639052188),
        [(1.2, 430.66), (2, 292.46), (2.8, 248.93), (4, 175.74), (5.66, 156.1), (8, 137.07), (11.3, 85.33), (16, 75.05),
         (22.6, 30.39), (30, 19.39)],
    ),
    "yellow-violet": (
        (0.0200454395, 0.0122329024, 0.0378004082),
        [(1.2, 43.75), (2, 27.21), (2.8, 18.19), (4, 17.08), (5.66, 12.16), (8, 8.03), (11.3, 12.61), (22.6, 5.66)],
    ),
    "grey": (
        (0.380453041, 0.176561585, 0.0298661185),
        [(1.2, 46.83), (2, 83.71), (2.8, 101.18), (4, 91.09), (5.66, 60.43), (22.6, 6.28), (30, 2.47)],
    ),
    "oblique": ((0.0467264940, -0.00423002912, 0.0388696220), [(1.2, 42.52), (2.8, 31.82), (8, 13.94)]),
    "oblique too": ((0.229393678, 0.0876028735, 0.0429318217), [(1.2, 37.45), (2.8, 41.91), (8, 21.66)]),
}  # fmt: skip


def test_people_saw_what_it_predicts_in_every_direction_of_colour():
    """Means of up to three observers: data set 'colorfest' of the authors' repository (MIT), fovea, 40 cd/m2.

    The model was fitted to these data among others; a wrong constant, matrix or sum would still miss them by far.
    """
    errors_db = []
    for change, points in MEASURED.values():
        frequency, measured = np.array(points).T
        direction = np.array(change) / COLORFEST_LMS
        found = cone_sensitivity(direction, frequency, 0, 40, 0, np.pi / 4, background_lms=COLORFEST_LMS)
        errors_db.append(20 * np.log10(found / measured))
    everything = np.concatenate(errors_db)
    assert np.sqrt((everything**2).mean()) < 3.3, "people differ by about as much from each other"
    assert abs(everything).max() < 7


def test_a_colour_of_one_mechanism_is_seen_by_that_mechanism():
    to_cones = np.linalg.inv(castle._CONES_TO_MECHANISMS) / np.array(D65_LMS)[:, None]
    for number, name in enumerate(castle.MECHANISMS):
        direction = to_cones[:, number]
        expected = limen.sensitivity(2, 5, 30, mechanism=name) / np.sqrt((direction**2).mean())
        np.testing.assert_allclose(cone_sensitivity(-direction, 2, 5, 30), expected, rtol=1e-9)
    assert cone_sensitivity(np.ones((4, 1, 3)), [[1, 2]]).shape == (4, 2)


@pytest.mark.parametrize("direction", [[0, 0, 0], [1, 2], [1, np.nan, 0]])
def test_what_is_no_direction_of_colour_is_refused(direction):
    with pytest.raises(InputError, match="cone_contrast"):
        cone_sensitivity(direction, 2)


def test_unknown_mechanisms_and_colour_of_colourless_models_are_refused():
    with pytest.raises(InputError, match="yellow-violet"):
        limen.sensitivity(1, mechanism="blue")
    with pytest.raises(InputError, match="yellow-violet"):
        limen.resolution_cpd(mechanism="blue")
    with pytest.raises(InputError, match="only castle"):
        limen.visible_cpd(1, model="barten", mechanism="red-green")
