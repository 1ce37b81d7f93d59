"""The small message that a frame is drawn from: who looks, who points, and how every layer lies.

Whoever has the message and the data draws the same frame, in another process and on another machine.
"""

from __future__ import annotations

import math
from typing import Any, TypeAlias

import msgspec
import numpy as np

from limen.errors import InputError
from limen.geometry import Floats
from limen.viewing.placement import InRoom, LookAt, OnShape, OnSurface
from limen.viewing.policy import Policy
from limen.viewing.tolerance import STANDS
from limen.viewing.viewer import Pointer, Viewer

__all__ = ["AnyPlacement", "FrameState", "LayerState", "decode", "encode"]

AnyPlacement: TypeAlias = OnSurface | OnShape | InRoom | LookAt


class LayerState(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """What of one layer changes from frame to frame.

    Parameters
    ----------
    placement
        How it lies on the display, or stands behind it.
    policy
        How viewers decide about its detail.
    overlay
        What is shown over it: one of its kind's words, or nothing.
    visible
        Whether it is drawn at all.
    motion
        How places of the room move with it, for policies with ``+motion``: the matrix (3, 4) of
        `limen.viewing.tolerance.Tolerance` by rows; ``None`` for what stands still.
    """

    placement: AnyPlacement
    policy: Policy = Policy()
    overlay: str = ""
    visible: bool = True
    motion: tuple[float, ...] | None = None

    def __post_init__(self) -> None:
        if self.motion is not None and not (len(self.motion) == 12 and all(map(math.isfinite, self.motion))):
            raise InputError(f"what moves does so by a matrix of 12 finite numbers, got {self.motion}")

    @property
    def motion_matrix(self) -> Floats:
        """``motion`` as a matrix, (3, 4)."""
        return STANDS if self.motion is None else np.reshape(np.array(self.motion), (3, 4))


class FrameState(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """All that a frame depends on besides data and display.

    Parameters
    ----------
    number
        Of the frame.
    time_s
        The show's clock: flights and animations go by it.
    viewers, pointers
        Who looks, the first of them at what is drawn for one eye; and who points.
    layers
        One for each layer of the show, in their order.
    """

    number: int = 0
    time_s: float = 0.0
    viewers: tuple[Viewer, ...] = ()
    pointers: tuple[Pointer, ...] = ()
    layers: tuple[LayerState, ...] = ()

    def __post_init__(self) -> None:
        if not math.isfinite(self.time_s):
            raise InputError(f"a frame's time_s must be finite, got {self.time_s}")


def encode(state: FrameState) -> bytes:
    """The message as MessagePack."""
    return _ENCODER.encode(state)


def decode(message: bytes) -> FrameState:
    """The state that was encoded, equal to the last bit.

    Raises
    ------
    InputError
        If this is no such message.
    """
    try:
        return _DECODER.decode(message)
    except (msgspec.MsgspecError, RecursionError) as error:
        raise InputError(f"a frame's message cannot be read: {error}") from None


def _plain(value: object) -> Any:
    """A lens's table, the only array of a message; and numbers that were taken out of arrays."""
    if isinstance(value, np.ndarray):
        return {"shape": value.shape, "data": value.astype("<f8").tobytes()}
    if isinstance(value, np.generic):
        return value.item()
    raise NotImplementedError(f"a message has no {type(value).__name__}")


def _array(_kind: type, value: Any) -> Any:
    if not (isinstance(value, dict) and {"data", "shape"} <= value.keys()):
        raise ValueError("a lens's table has data and a shape")
    return np.frombuffer(value["data"], "<f8").reshape(value["shape"])


_ENCODER = msgspec.msgpack.Encoder(enc_hook=_plain)
_DECODER = msgspec.msgpack.Decoder(FrameState, dec_hook=_array)
