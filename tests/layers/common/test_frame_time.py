"""Budgets in milliseconds: what fits is found within some frames, whatever a frame costs, and kept."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from limen.errors import InputError
from limen.layers.common.frame_time import FrameTimeBudget
from limen.viewing.policy import Policy


def run(
    max_ms: float, fixed_ms: float, per_item_ms: float, *, noise: float = 0.0, hitches: float = 0.0, frames: int = 80
):
    """Times and numbers of items of frames on a machine with a constant part, noise, and hitches of ten times."""
    rng = np.random.default_rng(int(max_ms * 1000))
    throttle, policy = FrameTimeBudget(), Policy("budget", max_ms=max_ms)
    times, items = [], []
    for _ in range(frames):
        within = throttle.within(policy)
        assert within.max_ms is None
        ms = (fixed_ms + per_item_ms * within.max_items) * np.exp(noise * rng.normal())
        throttle.spent(policy, ms * (10 if rng.random() < hitches else 1))
        times.append(ms)
        items.append(within.max_items)
    return np.array(times), np.array(items)


@given(st.floats(4, 60), st.floats(0, 0.5), st.floats(-5.5, -2.5))
@settings(max_examples=60, deadline=None)
def test_a_quiet_machine_comes_to_the_budget_and_stays(max_ms, fixed_share, log_ms):
    times, items = run(max_ms, fixed_share * max_ms, 10**log_ms)
    if items[-1] > 500:
        np.testing.assert_allclose(times[30:], max_ms, rtol=0.12)
        assert len(set(items[60:])) == 1, "nothing changes where nothing has to"


def test_noise_and_hitches_change_little():
    times, items = run(16, 3, 2e-4, noise=0.1, hitches=0.05, frames=300)
    assert np.median(times[20:]) == pytest.approx(16, rel=0.15)
    assert items[20:].std() < 0.25 * items[20:].mean()


def test_more_time_buys_more_and_too_little_buys_the_least():
    bought = [run(ms, 2, 1e-4)[1][-1] for ms in (1, 4, 8, 16, 33)]
    assert bought == sorted(bought)
    assert bought[0] == 500
    assert bought[-1] > 250_000


def test_parts_of_a_frame_share_its_time():
    throttle, policy = FrameTimeBudget(4), Policy("budget", max_ms=20)
    for _ in range(60):
        throttle.spent(policy, 1e-4 * throttle.within(policy).max_items)
    assert 1e-4 * throttle.within(policy).max_items == pytest.approx(5, rel=0.1)


def test_other_policies_are_left_alone_and_a_time_is_no_number():
    plain = Policy("contrast", gaze=True)
    assert FrameTimeBudget().within(plain) is plain
    assert Policy.parse("budget+gaze:12ms").title == "budget+gaze:12ms"
    assert Policy.parse("budget:8ms").eyesight == Policy("contrast")
    for text in ("budget:-3ms", "budget:0ms", "budget:ms", "size:12ms", "contrast:12ms"):
        with pytest.raises(InputError):
            Policy.parse(text)
    with pytest.raises(InputError, match="budget:30000"):
        _ = Policy("budget", max_ms=5).timeless
