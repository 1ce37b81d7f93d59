"""What passes is seen less sharply: Daly's velocities of the eye, and no more of it than castleCSF loses."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from limen.vision.castle_csf import log_sensitivity
from limen.vision.motion import MOST_DEG_S, motion_scale, retinal_velocity_deg_s

speeds = st.floats(0, 500)


def test_eyes_follow_as_daly_says() -> None:
    assert retinal_velocity_deg_s([0, 0.5, 10, 50, 97.4, 120]) == pytest.approx(
        [0.15, 0.15, 1.65, 8.85, 17.4, 40], abs=0.02
    )


@given(speeds, speeds, st.floats(1, 9), st.floats(1, 9))
def test_what_passes_faster_or_farther_off_is_never_seen_better(a: float, b: float, c: float, d: float) -> None:
    (slow, fast), (near, far) = sorted((a, b)), sorted((c, d))
    assert (
        1 <= motion_scale(slow, far) <= motion_scale(fast, far) <= motion_scale(fast, near) <= motion_scale(500.0) < 2
    )
    assert near * motion_scale(fast, near) <= far * motion_scale(fast, far)


@pytest.mark.parametrize("light_cd_m2", [10.0, 100.0, 300.0])
@pytest.mark.parametrize("velocity_deg_s", [5.0, 10.0, 30.0])
def test_castle_loses_more_along_the_motion(light_cd_m2: float, velocity_deg_s: float) -> None:
    """Whatever the contrast, the highest frequency seen falls by more than a detail may grow."""
    glides = min(float(retinal_velocity_deg_s(velocity_deg_s)), MOST_DEG_S)
    frequency_cpd = np.geomspace(0.5, 64, 2000)
    still, moving = (
        log_sensitivity(frequency_cpd, np.zeros(1), np.array(light_cd_m2), hertz, np.ones(1))
        for hertz in (np.zeros(1), glides * frequency_cpd)
    )
    for sensitivity in (3, 10, 30, 60):
        cut_off = [frequency_cpd[np.flatnonzero(each >= np.log10(sensitivity))[-1]] for each in (still, moving)]
        assert cut_off[0] / cut_off[1] > motion_scale(velocity_deg_s), sensitivity
