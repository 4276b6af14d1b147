"""The bounds of a frame once more, by hand: what was accepted must lie within them.

Owns: these figures, from docs/protocol.md. Must not know: how a frame is decoded.
"""

from __future__ import annotations

from etd.protocol.errors import Refused
from etd.protocol.frame import Frame, check_shape
from fuzz.sentences import check_refusal

_ARRAYS = (4, 64)
_POLARITIES = ("anodic", "cathodic", "biphasic", "biphasic_cathodic_first")


def check_frame(frame: Frame) -> None:
    """Its values; and its shape, for arrays that it was made for."""
    _check_values(frame)
    for electrodes in _ARRAYS:
        try:
            check_shape(frame, electrodes)
        except Refused as refusal:
            check_refusal(refusal)
        else:
            _check_shape(frame, electrodes)


def _each(value: object) -> tuple[object, ...]:
    if value is None:
        return ()
    return value if isinstance(value, tuple) else (value,)


def _check_values(frame: Frame) -> None:
    for key, low, high, kind in (
        ("level", 0.0, 1.0, float),
        ("current_ua", 0, 10_000, int),
        ("width_us", 20, 200, int),
        ("rate_hz", 0.1, 200.0, float),
        ("ttl_ms", 1, 1_000, int),
        ("lasts_ms", 1, 1_000, int),
        ("pulses", 1, 100_000, int),
        ("seq", 0, 2**63 - 1, int),
        ("renews", 0, 2**63 - 1, int),
    ):
        for value in _each(getattr(frame, key)):
            assert type(value) is kind, (key, value)
            assert low <= value <= high, (key, value)
    assert set(_each(frame.polarity)) <= set(_POLARITIES)


def _check_shape(frame: Frame, electrodes: int) -> None:
    assert (frame.level is None) != (frame.current_ua is None)
    for key in ("level", "current_ua", "width_us", "rate_hz", "polarity"):
        value = getattr(frame, key)
        assert not isinstance(value, tuple) or len(value) == electrodes, key
    if isinstance(frame.returns, tuple):
        assert len(frame.returns) == electrodes
        for electrode, members in enumerate(frame.returns):
            others = set(range(electrodes)) - {electrode}
            assert set(members) <= others
            assert len(set(members)) == len(members)
    assert frame.on_trigger or (frame.lasts_ms is None and frame.renews is None)
