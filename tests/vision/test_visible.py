"""The inverses: against the forward model, against brute force, and the laws that selectors lean on."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import limen
from limen.errors import InputError
from limen.vision.acuity import HUMAN_ARCMIN, human_arcmin, optimal_distance_m
from limen.vision.castle_csf import log_sensitivity
from limen.vision.resolution import luminance_scale
from limen.vision.visible import visible_cpd, visible_distance_m

contrasts, degrees, lights = st.floats(0.002, 1), st.floats(0, 60), st.floats(1, 1000)


@given(contrasts, st.floats(0, 20), st.floats(0.02, 3000), st.floats(0, 10), st.floats(0.1, 10))
def test_the_model_sees_the_contrast_there_and_not_beyond(contrast, eccentricity, light, hertz, area):
    found = float(visible_cpd(contrast, eccentricity, light, hertz, area, floor="none"))
    beyond = np.geomspace(max(found, 1 / 16), 256, 2000)
    where = [np.asarray(value) for value in (eccentricity, light, hertz, area)]
    seen = 10 ** log_sensitivity(beyond, *where) * contrast
    assert seen[1:].max() <= 1.01, "nothing finer is visible; 1 % for a peak that is only just seen"
    if found:
        assert seen[0] == pytest.approx(1, rel=1e-4), "and there it is just visible"


@pytest.mark.parametrize("model", ["castle", "barten", "mannos-sakrison"])
def test_inverse_and_forward_agree_above_the_peak(model):
    frequency = np.geomspace(10, 60, 40)
    seen = limen.sensitivity(frequency, model=model)
    np.testing.assert_allclose(visible_cpd(1 / seen, model=model, floor="none"), frequency, rtol=1e-6)


def test_what_people_saw_is_never_called_invisible():
    eccentricity = np.arange(0, 31.0)
    contrast = 1 / 1.0949
    assert (visible_cpd(contrast, eccentricity) >= limen.resolution_cpd(eccentricity) - 1e-9).all()
    assert visible_cpd(contrast, 20.0) == pytest.approx(float(limen.resolution_cpd(20.0))), "the periphery is theirs"
    assert visible_cpd(contrast, 20.0, floor="none") < 0.7 * visible_cpd(contrast, 20.0), "castleCSF alone is too bold"
    for mechanism, stark in (("red-green", 7.4154), ("yellow-violet", 2.0517)):
        resolved = limen.resolution_cpd(eccentricity, mechanism=mechanism)
        assert (visible_cpd(1 / stark, eccentricity, mechanism=mechanism) >= resolved - 1e-9).all()


def test_nothing_is_seen_of_no_contrast():
    assert visible_cpd([0, 1e-40, 0.004]).tolist() == [0, 0, 0]
    assert visible_distance_m(0, 0.01) == 0
    assert np.isfinite(visible_cpd(np.linspace(0, 1, 9)[:, None], [0, 200], 1e9)).all()


@given(contrasts, degrees, lights, st.floats(1.001, 2))
def test_more_contrast_nearer_the_gaze_shows_more(contrast, eccentricity, light, factor):
    here = visible_cpd(contrast, eccentricity, light)
    assert visible_cpd(contrast * factor, eccentricity, light) >= here * (1 - 1e-6)
    assert visible_cpd(contrast, eccentricity * factor, light) <= here * (1 + 1e-6)


@given(st.floats(4.5, 64), degrees, lights, st.floats(1.001, 2))
def test_above_the_peak_finer_is_seen_worse(frequency, eccentricity, light, factor):
    here = limen.sensitivity(frequency, eccentricity, light)
    assert limen.sensitivity(frequency * factor, eccentricity, light) <= here
    assert limen.sensitivity(frequency, eccentricity * factor, light) <= here


def test_off_the_gaze_at_least_what_the_fit_says_is_lost():
    """``visible_cpd(c, e, L) <= visible_cpd(c, 0, L) / (1 + 0.16008 e)``: selectors bound whole panels with it.

    It holds from 4.6 cd/m2 on. In dimmer light castleCSF falls more steeply with frequency than with eccentricity, and
    between 1 and 4.6 cd/m2 the law is short by up to 3.3 %.
    """
    contrast = np.geomspace(0.002, 1, 70)[:, None, None]
    eccentricity = np.concatenate([np.linspace(0, 10, 101), np.linspace(10.5, 60, 100)])[:, None]
    light = np.concatenate([np.geomspace(1, 4.5, 6), np.geomspace(4.6, 1000, 18)])
    seen = visible_cpd(contrast, eccentricity, light)
    ratio = seen * (1 + 0.16008 * eccentricity) / np.maximum(seen[:, :1], 1e-9)
    assert ratio[..., light >= 4.6].max() <= 1 + 1e-6
    assert 1.03 < ratio[..., light < 4.6].max() <= 1.033, "and that is no more than stated"


def test_more_light_shows_more_up_to_1000_cd_m2():
    contrast = np.geomspace(0.002, 1, 60)[:, None]
    seen = visible_cpd(contrast, 0, np.geomspace(0.1, 1000, 200))
    assert (np.diff(seen, axis=1) >= -1e-6 * seen[:, 1:]).all()
    assert (np.diff(luminance_scale(np.geomspace(0.0113, 1000, 300))) > 0).all()


def test_the_distance_puts_one_cycle_at_the_frequency():
    period = 2 * 0.00027
    for contrast in (1, 0.3, 0.02):
        distance = visible_distance_m(contrast, period, 3, 50)
        cycle_deg = np.degrees(np.arctan(period / distance))
        assert 1 / cycle_deg == pytest.approx(float(visible_cpd(contrast, 3, 50)), rel=1e-9)
    one_pixel_arcmin = 30 / float(visible_cpd(1))
    assert visible_distance_m(1, period) == pytest.approx(optimal_distance_m(period / 2, one_pixel_arcmin), rel=1e-6)
    assert visible_distance_m([[1], [0.1]], [0.001, 0.002, 0.1]).shape == (2, 3)
    with pytest.raises(InputError, match="period_m"):
        visible_distance_m(1, [1, 0])


def test_arcminutes_follow_the_light():
    assert human_arcmin(100) == pytest.approx(HUMAN_ARCMIN, rel=0.02)
    assert 60 / (2 * human_arcmin(10)) == pytest.approx(0.635 * 47.69, rel=1e-3)
    assert human_arcmin([1, 10, 100]).shape == (3,)


def test_nonsense_is_refused():
    for bad in ({"contrast": -0.1}, {"contrast": np.nan}, {"contrast": 1, "area_deg2": np.inf}):
        with pytest.raises(InputError, match="finite and not negative"):
            visible_cpd(**bad)
    with pytest.raises(InputError, match="human or none"):
        visible_cpd(1, floor="owl")
