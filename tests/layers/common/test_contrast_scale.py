"""How fine a detail of some contrast can be seen: more contrast, finer; as fine as vision says."""

import numpy as np
import pytest

from limen.layers.common.contrast_scale import acuity_scale_of_contrast
from limen.vision.contrast_codes import CONTRAST_OF_CODE, FULL_CODE
from limen.vision.resolution import resolution_cpd
from limen.vision.visible import visible_cpd


def test_more_contrast_is_never_seen_less():
    shares = acuity_scale_of_contrast([80.0, 300.0])
    assert shares[0] == 0
    assert shares[FULL_CODE] == 1
    assert (np.diff(shares) >= 0).all()


def test_of_several_panels_the_one_that_shows_most_decides():
    both = acuity_scale_of_contrast([1.0, 300.0])
    assert (both >= np.maximum(acuity_scale_of_contrast(1.0), acuity_scale_of_contrast(300.0)) - 1e-12).all()


@pytest.mark.parametrize("code", [60, 110, 160])
def test_where_sensitivity_was_measured_a_share_is_no_less_than_its_model_says(code):
    finest = visible_cpd(CONTRAST_OF_CODE[code], 0.0, 100.0) / resolution_cpd(0.0, 100.0)
    assert acuity_scale_of_contrast(100.0)[code] >= min(float(finest), 1.0) * 0.999
