"""Contrast in eight bits: never less than what it stands for, and hardly more."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from limen.errors import InputError
from limen.vision.contrast_codes import CONTRAST_OF_CODE, FULL_CODE, code_of_contrast, code_of_luminances


@given(st.floats(0, 1))
def test_a_code_is_no_less_than_the_contrast_and_one_less_would_be(contrast):
    code = int(code_of_contrast(contrast))
    assert CONTRAST_OF_CODE[code] >= contrast
    assert code == 0 or CONTRAST_OF_CODE[code - 1] < contrast


@given(st.floats(0.001, 1))
def test_a_code_is_at_most_a_thirtieth_more(contrast):
    assert CONTRAST_OF_CODE[code_of_contrast(contrast)] <= contrast * 1.03


def test_the_darkest_and_the_brightest_both_count():
    assert code_of_luminances(10.0, 10.0, 30.0) == code_of_contrast(0.5)
    assert code_of_luminances(30.0, 10.0, 30.0) == code_of_contrast(0.5)
    assert code_of_luminances(0.0, 0.0, 0.0) == 0
    assert code_of_luminances(1.0, 0.0, 1.0) == FULL_CODE


@pytest.mark.parametrize("contrast", [-0.1, 1.1, np.nan])
def test_what_is_no_contrast_is_refused(contrast):
    with pytest.raises(InputError, match="from 0 to 1"):
        code_of_contrast(contrast)
