"""The message of a frame: it comes back equal, to the last bit and byte, and what is no such message is refused."""

from __future__ import annotations

import math
from typing import Any

import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from limen.errors import InputError
from limen.geometry import Vec3, length, normalised
from limen.viewing.lens import DROP_OFFS, Lens
from limen.viewing.placement import FITS, InRoom, LookAt, OnShape, OnSurface
from limen.viewing.policy import Policy
from limen.viewing.state import FrameState, LayerState, decode, encode
from limen.viewing.tessellation import LENS_MODES, Tessellation
from limen.viewing.viewer import Pointer, Viewer

laws = settings(deadline=None, max_examples=25)


def hill(down: int, across: int, top: float) -> NDArray[np.float64]:
    """A table of heights that falls from its middle."""
    ways = (np.minimum(np.arange(size) + 1, size - np.arange(size)) for size in (down, across))
    table = np.minimum.outer(*ways).astype(float)
    return np.asarray(table * top / table.max())


HILLS = [hill(2, 2, 1.0), hill(5, 9, 0.7), hill(8, 3, 1 / 3)]

# ---------------------------------------------------------------------- all that can be said

numbers = st.floats(-1e9, 1e9)
places = st.tuples(numbers, numbers, numbers)
texts = st.text(max_size=12)
ways: st.SearchStrategy[Vec3] = st.one_of(
    st.tuples(*[st.floats(-1, 1)] * 3),
    st.tuples(*[st.floats(-1e100, 1e100)] * 3),
    st.tuples(*[st.integers(-3, 3)] * 3),
    st.sampled_from([(0.0, 0.0, -1.0), (0.0, -0.0, 1.0), (0.6, 0.8, 0.0), (1e-11, 0.0, 0.0)]),
).filter(lambda way: length(way) >= 1e-12)
headings = st.one_of(ways, ways.map(lambda way: normalised(way, "way")))

viewers = st.builds(
    Viewer, places, headings, gaze=st.none() | headings, acuity_arcmin=st.none() | st.floats(0.01, 600),
    time_s=numbers, eye_separation_m=st.floats(0, 1, exclude_max=True), name=texts, velocity_m_s=places,
)  # fmt: skip
pointers = st.builds(Pointer, places, headings, time_s=numbers, name=texts)

sights: dict[str, Any] = {
    "acuity_arcmin": st.floats(0.01, 600), "gaze": st.booleans(), "distance_factor": st.floats(1e-3, 1e3),
    "head_slack_deg": st.floats(0, 180), "motion": st.booleans(),
}  # fmt: skip
policies = st.one_of(
    st.builds(Policy, st.sampled_from(["full", "acuity", "contrast", "scheel"]), **sights),
    st.builds(Policy, st.sampled_from(["budget", "size"]), max_items=st.integers(1, 1 << 62), **sights),
    st.builds(Policy, st.just("budget"), max_ms=st.floats(0.01, 1e4), **sights),
)

spots = st.tuples(numbers, numbers)
sizes = st.floats(0.01, 1e6)
plain_lenses = st.builds(
    Lens, spots, sizes | st.tuples(sizes, sizes), st.floats(1, 100), st.floats(0, 1, exclude_max=True),
    st.sampled_from(DROP_OFFS), st.sampled_from(["radial", "rectangular"]),
)  # fmt: skip
lenses_by_tables = st.builds(
    Lens, spots, sizes | st.tuples(sizes, sizes), st.sampled_from([1.0, 2.5]), heights=st.sampled_from(HILLS)
)
some_lenses = st.lists(plain_lenses | lenses_by_tables, max_size=2).map(tuple)
tessellations = st.builds(
    Tessellation, st.sampled_from(LENS_MODES), st.integers(1, 32), st.integers(32, 1024), sizes, sizes
)
surfaces = st.builds(
    OnSurface, st.sampled_from(FITS), st.floats(1e-3, 1e3), st.tuples(numbers, numbers), some_lenses,
    tessellations, some_lenses,
)  # fmt: skip

long, short = st.floats(1, 10), st.floats(-0.4, 0.4)
shapes = st.builds(
    OnShape, st.sampled_from(["plane", "cylinder", "ellipsoid"]), places, st.tuples(long, short, short),
    st.tuples(short, long, short), st.none() | st.tuples(short, short, long),
    st.floats(0, 360, exclude_min=True), st.none() | places,
)  # fmt: skip
rooms = st.builds(InRoom, st.tuples(*[numbers] * 12))
shares = st.floats(0, 1)
looks = st.builds(
    LookAt, st.tuples(shares, shares), numbers, st.floats(0, 90), st.none() | st.floats(0.01, 1e7),
    st.floats(0.001, 1000),
)  # fmt: skip
placements: dict[str, st.SearchStrategy[Any]] = {
    "on the surface": surfaces, "on a shape": shapes, "in the room": rooms, "looked at": looks,
}  # fmt: skip

layers = st.builds(
    LayerState, placement=st.one_of(*placements.values()), policy=policies, overlay=texts, visible=st.booleans(),
    motion=st.none() | st.tuples(*[numbers] * 12),
)  # fmt: skip
frames = st.builds(
    FrameState, number=st.integers(-(1 << 63), (1 << 63) - 1), time_s=numbers,
    viewers=st.lists(viewers, max_size=2).map(tuple), pointers=st.lists(pointers, max_size=2).map(tuple),
    layers=st.lists(layers, max_size=2).map(tuple),
)  # fmt: skip


def assert_comes_back(frame: FrameState) -> None:
    """Equal, and to the last bit: numbers that are equal but for their sign are other bytes."""
    message = encode(frame)
    received = decode(message)
    assert received == frame
    assert encode(received) == message


# ---------------------------------------------------------------------- what is sent comes back


@laws
@given(frames)
def test_a_frame_comes_back_equal(frame: FrameState) -> None:
    assert_comes_back(frame)


@laws
@given(st.lists(viewers, max_size=3), st.lists(pointers, max_size=3))
def test_whoever_looks_and_points_comes_back_equal(people: list[Viewer], hands: list[Pointer]) -> None:
    assert_comes_back(FrameState(viewers=tuple(people), pointers=tuple(hands)))


@pytest.mark.parametrize("how", placements)
def test_every_placement_comes_back_equal(how: str) -> None:
    @laws
    @given(placements[how])
    def comes_back(placement: Any) -> None:
        assert_comes_back(FrameState(layers=(LayerState(placement=placement),)))

    comes_back()


@laws
@given(policies, st.none() | st.tuples(*[numbers] * 12), texts)
def test_policies_motion_and_overlays_come_back_equal(
    policy: Policy, motion: tuple[float, ...] | None, overlay: str
) -> None:
    layer = LayerState(placement=LookAt(), policy=policy, overlay=overlay, motion=motion)
    frame = FrameState(layers=(layer,))
    assert_comes_back(frame)
    (received,) = decode(encode(frame)).layers
    assert received.policy.label == policy.label
    assert np.array_equal(received.motion_matrix, layer.motion_matrix)


def test_what_is_not_said_is_as_it_is_by_default() -> None:
    assert decode(encode(FrameState())) == FrameState()
    assert len(encode(FrameState())) == 1
    assert decode(encode(FrameState(layers=(LayerState(placement=OnSurface()),)))).layers[0].placement == OnSurface()


def test_numbers_from_arrays_and_whole_ones_are_numbers() -> None:
    """What was computed with arrays, or typed without a point, is the same as soon as it has been sent."""
    one, two = np.array([1.0, 2.0])
    single: Any = np.float32(40)
    whole: Any = np.int64(3)
    look = LookAt((0, 1), heading_deg=one, range_m=two, pitch_deg=single)
    frame = FrameState(
        number=whole, time_s=two, viewers=(Viewer((one, two, 0), time_s=one),),
        layers=(LayerState(placement=look), LayerState(placement=OnSurface(lenses=(Lens((one, 2), two),)))),
    )  # fmt: skip
    received = decode(encode(frame))
    assert received == frame
    assert_comes_back(received)
    assert type(received.number) is int
    assert {type(number) for number in (received.time_s, received.viewers[0].time_s)} == {float}


@laws
@given(ways)
def test_unit_vectors_stay_what_they_are(way: Vec3) -> None:
    unit = normalised(way, "way")
    assert abs(length(unit) - 1) < 1e-15
    assert normalised(unit, "way") == unit
    assert [math.copysign(1, one) for one in unit] == [math.copysign(1, one) for one in way]


def test_unit_vectors_stay_what_they_are_however_they_were_rounded() -> None:
    rng = np.random.default_rng(1)
    for x, y, z in (rng.normal(size=(10_000, 3)) * 10.0 ** rng.integers(-9, 9, (10_000, 3))).tolist():
        unit = normalised((x, y, z), "way")
        assert normalised(unit, "way") == unit


def test_lenses_are_the_same_by_what_they_say() -> None:
    """What is kept of one frame's lenses is found again by those of the next frame's message."""
    table = HILLS[1]
    lens = Lens((5.0, 6.0), (3.0, 2.0), 2.5, heights=table)
    frame = FrameState(layers=(LayerState(placement=OnSurface(lenses=(lens,))),))
    placement = decode(encode(frame)).layers[0].placement
    assert isinstance(placement, OnSurface)
    (received,) = placement.lenses
    assert received is not lens
    assert received == lens
    assert hash(received) == hash(lens)
    assert received.heights is not None
    assert not received.heights.flags.writeable
    others = [
        Lens((5.0, 6.5), (3.0, 2.0), 2.5, heights=table), Lens((5.0, 6.0), 3.0, 2.5, heights=table),
        Lens((5.0, 6.0), (3.0, 2.0), 2.0, heights=table), Lens((5.0, 6.0), (3.0, 2.0), 2.5, heights=table / 2),
        Lens((5.0, 6.0), (3.0, 2.0), 2.5, heights=table.T), Lens((5.0, 6.0), (3.0, 2.0), 2.5),
        Lens((5.0, 6.0), (3.0, 2.0), 2.5, 0.1), Lens((5.0, 6.0), (3.0, 2.0), 2.5, shape="rectangular"),
        Lens((5.0, 6.0), (3.0, 2.0), 2.5, drop_off="linear"), lens.centre_px,
    ]  # fmt: skip
    assert all(other != lens for other in others)
    assert len({lens, received, *others}) == 1 + len(others)


# ---------------------------------------------------------------------- what is no message

FULL = FrameState(
    number=7, time_s=1.25, viewers=(Viewer((0.3, 1.5, 0.2), gaze=(-0.4, -0.1, -1.0), name="one"),),
    pointers=(Pointer((0.5, 1.3, 0.1), (-0.3, 0.1, -2.0)),),
    layers=(
        LayerState(placement=OnSurface("cover", lenses=(Lens((9.0, 9.0), 3.0, 2.5, heights=HILLS[0]),))),
        LayerState(placement=OnShape("ellipsoid", (0, 1.5, 0), (6, 0, -6), (0, -9, 0), eye_m=(0, 1, 0))),
        LayerState(placement=InRoom.of(np.eye(4)), policy=Policy.parse("budget+gaze:300"), motion=(0.5,) * 12),
        LayerState(placement=LookAt(range_m=500.0), overlay="patches"),
    ),
)  # fmt: skip
MESSAGE = encode(FULL)


def test_a_message_that_was_cut_off_is_refused() -> None:
    for kept in range(len(MESSAGE)):
        with pytest.raises(InputError, match="cannot be read"):
            decode(MESSAGE[:kept])


@settings(deadline=None, max_examples=150)
@given(st.integers(0, len(MESSAGE) - 1), st.integers(0, 2), st.binary(max_size=3))
def test_damage_is_refused_or_is_another_message(begin: int, gone: int, put: bytes) -> None:
    """Whatever is read can be sent again."""
    try:
        received = decode(MESSAGE[:begin] + put + MESSAGE[begin + gone :])
    except InputError:
        return
    assert_comes_back(received)


@laws
@given(st.binary(max_size=40))
def test_other_bytes_are_refused_or_say_nothing(message: bytes) -> None:
    try:
        assert_comes_back(decode(message))
    except InputError:
        return


def packed(**fields: Any) -> bytes:
    return msgspec.msgpack.encode(fields)


def with_layer(placement: dict[str, Any], **fields: Any) -> bytes:
    return packed(layers=[{"placement": placement, **fields}])


def with_table(table: Any) -> bytes:
    lens = {"centre_px": [1.0, 2.0], "radius_px": 3.0, "heights": table}
    return with_layer({"type": "OnSurface", "lenses": [lens]})


LOOK = {"type": "LookAt"}
SHAPE = {"type": "OnShape", "kind": "cylinder", "origin_m": [0, 0, 0], "across": [0, 0, -1], "down": [0, -1, 0]}
FLAT = np.zeros(4).tobytes()
WRONG = {
    "nothing": b"",
    "a picture": b"\x89PNG\r\n\x1a\n",
    "JSON": b'{"number": 3}',
    "a number": msgspec.msgpack.encode(3),
    "a list": msgspec.msgpack.encode([1, 2]),
    "two messages": MESSAGE + MESSAGE,
    "a time that is none": packed(time_s=math.nan),
    "a name for a number": packed(number="seven"),
    "a viewer nowhere": packed(viewers=[{"position_m": [0, 0, math.inf]}]),
    "a viewer without a head": packed(viewers=[{"position_m": [0, 0, 0], "direction": [0, 0, 0]}]),
    "a viewer who looks too far": packed(viewers=[{"position_m": [0, 0, 0], "gaze": [1e200, 0, 0]}]),
    "a pointer in a plane": packed(pointers=[{"position_m": [0, 0], "direction": [0, 1, 0]}]),
    "an unknown placement": with_layer({"type": "Anywhere"}),
    "no placement": packed(layers=[{"overlay": "levels"}]),
    "an unknown fit": with_layer({"type": "OnSurface", "fit": "stretch"}),
    "a flat shape": with_layer(SHAPE | {"down": [0, 0, 1]}),
    "an endless shape": with_layer(SHAPE | {"across": [1e200, 0, 0], "down": [0, 1e200, 0]}),
    "a shape of no depth": with_layer(SHAPE | {"depth": [math.nan, 0, 0]}),
    "a shape's eye nowhere": with_layer(SHAPE | {"eye_m": [math.nan, 0, 0]}),
    "a room of eleven": with_layer({"type": "InRoom", "room_from_content": [1.0] * 11}),
    "a look from below": with_layer({"type": "LookAt", "pitch_deg": -1.0}),
    "an unknown policy": with_layer(LOOK, policy={"name": "best"}),
    "a policy that may spend nothing": with_layer(LOOK, policy={"name": "budget"}),
    "a motion of two": with_layer(LOOK, motion=[1.0, 2.0]),
    "a motion without end": with_layer(LOOK, motion=[math.inf] * 12),
    "a lens that shrinks": with_layer(
        {"type": "OnSurface", "lenses": [{"centre_px": [1, 2], "radius_px": 3, "magnification": 0.5}]}
    ),
    "a table that is a number": with_table(3),
    "a table of nothing": with_table({}),
    "a table without numbers": with_table({"shape": [2, 2]}),
    "a table without a shape": with_table({"data": FLAT}),
    "a table of another shape": with_table({"shape": [2, 3], "data": FLAT}),
    "a table that is cut off": with_table({"shape": [2, 2], "data": FLAT[:-1]}),
    "a table larger than memory": with_table({"shape": [1 << 62, 1 << 62], "data": FLAT}),
    "a table of text": with_table({"shape": [2, 2], "data": "text" * 8}),
    "a table of what is no number": with_table({"shape": [2, 2], "data": np.full(4, np.nan).tobytes()}),
    "boxes in boxes": with_table(0)[:-1] + b"\x91" * 100_000 + b"\x90",
}


@pytest.mark.parametrize("message", WRONG.values(), ids=WRONG.keys())
def test_what_is_no_message_is_refused(message: bytes) -> None:
    with pytest.raises(InputError, match="a frame's message cannot be read: "):
        decode(message)


def test_what_cannot_be_is_refused_before_it_is_sent() -> None:
    with pytest.raises(InputError, match="12 finite numbers"):
        LayerState(placement=LookAt(), motion=(1.0, 2.0))
    with pytest.raises(InputError, match="time_s must be finite"):
        FrameState(time_s=math.inf)
