"""What is misspelt in a program: the refusal names what there is to choose."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest

from etd import Display, Pattern, PatternFrame, Refused
from etd.client.array import ElectrodeArray
from etd.protocol.errors import PatternError
from gateway_rig import GatewayRig, ServedRig
from scripted_engine import engine_hello

pytestmark = pytest.mark.slow

FIRST = [1, 0, 0, 0]
POLARITIES = "anodic, cathodic, biphasic, biphasic_cathodic_first"
RETURNS = '"all", {"ring_mm": a radius}, or a list of electrodes for each electrode'
SILENT = Pattern(electrodes=4, frames=(PatternFrame(duration_ms=10, level=(0.0,) * 4),))


@pytest.fixture
def rig() -> Iterator[ServedRig]:
    with ServedRig() as rig:
        yield rig


#: Every method that takes the options of a frame, or of a pattern.
METHODS: list[Callable[..., Any]] = [
    lambda d, **given: d.show(FIRST, **given),
    lambda d, **given: d.show_current(FIRST, **given),
    lambda d, **given: d.preview(FIRST, **given),
    lambda d, **given: d.hold(FIRST, 0.1, **given),
    lambda d, **given: d.hold_current(FIRST, 0.1, **given),
    lambda d, **given: d.stream(FIRST, **given),
    lambda d, **given: d.stream_current(FIRST, **given),
    lambda d, **given: d.present(FIRST, 0.1, **given),
    lambda d, **given: d.present_current(FIRST, 0.1, **given),
    lambda d, **given: d.begin(FIRST, 0.1, **given),
    lambda d, **given: d.begin_current(FIRST, 0.1, **given),
    lambda d, **given: d.play(SILENT, **given),
    lambda d, **given: d.check_pattern(SILENT, **given),
]


@pytest.mark.parametrize(
    ("given", "choices"),
    [
        ({"polarity": "anodal"}, POLARITIES),
        ({"polarity": 3}, POLARITIES),
        ({"returns": "al"}, RETURNS),
        ({"returns": {"ring": 5.0}}, RETURNS),
        ({"returns": 5.0}, RETURNS),
        ({"polarty": "anodic"}, "it has "),
    ],
)
def test_every_method_names_the_choices(
    rig: ServedRig, given: dict[str, Any], choices: str
) -> None:
    with Display(address=rig.address, max_current_ua=3000, width_us=100) as d:
        for method in METHODS:
            with pytest.raises(Refused) as caught:
                method(d, **given)
            assert choices in caught.value.reason
            assert "\n" not in str(caught.value)
        with pytest.raises(Refused, match="choose of state, scan, contact"):
            d.telemetry("scans")  # type: ignore[arg-type]
        other: Any = "anodal"
        silent = PatternFrame(duration_ms=10, level=(0.0,) * 4, polarity=other)
        with pytest.raises(PatternError, match='give "anodic", "biphasic", "biph'):
            d.play(Pattern(electrodes=4, frames=(silent,)))
    assert rig.engine.frames == []


@pytest.mark.parametrize("level", [1_500, -0.1, np.float64(1.01)])
def test_a_current_given_as_a_level_is_told_where_it_goes_before_anything_is_armed(
    rig: ServedRig, level: float
) -> None:
    words = r"level\[0\] is .*: levels go from 0, silent, to 1.* given as current_ua"
    with Display(address=rig.address, max_current_ua=3000, width_us=100) as d:
        with pytest.raises(Refused, match=words) as caught:
            d.show([level, 0, 0, 0])
        assert caught.value.electrode == 0
        with pytest.raises(Refused, match=words):
            d.arm(open_to=level)
    assert rig.engine.heard == []


def test_a_polarity_that_is_none_is_named_with_its_electrode(rig: ServedRig) -> None:
    mixed: Any = ["anodic", "x", "anodic", "anodic"]
    with (
        Display(address=rig.address, max_current_ua=3000, width_us=100) as d,
        pytest.raises(Refused, match=r"polarity\[1\]='x'") as caught,
    ):
        d.show(FIRST, polarity=mixed)
    assert caught.value.electrode == 1


def test_what_a_name_may_be_is_said_in_words(rig: ServedRig) -> None:
    words = "a name has 1 to 32 letters from A to Z, digits, hyphens or underscores"
    with Display(address=rig.address, max_current_ua=3000, width_us=100) as d:
        for asking in (
            d.start_record,
            d.delete_record,
            d.calibration,
            d.delete_calibration,
            lambda name: d.fetch_record(name, lambda _: None),
        ):
            for name in ("p 01", "", "p" * 33, "../x"):
                with pytest.raises(Refused, match=words):
                    asking(name)


@pytest.mark.parametrize(
    ("request_", "said"),
    [
        ({"op": "frame", "polarity": "anodal"}, f"give {POLARITIES}"),
        ({"op": "frame", "polarity": 3}, f"give {POLARITIES}"),
        ({"op": "frame", "returns": "al"}, f"give {RETURNS}"),
        ({"op": "frame", "returns": {"ring": 3}}, f"give {RETURNS}"),
        ({"op": "record", "do": "begin"}, "give start, stop, list, get, delete"),
        ({"op": "calibration", "do": "fetch"}, "a process of the operator's own"),
    ],
)
def test_so_does_the_daemon_in_any_language(request_: dict[str, Any], said: str) -> None:
    with GatewayRig() as rig:
        asked = {"lease": rig.open(), "seq": 1, "current_ua": FIRST, **request_}
        if asked["op"] != "frame":
            asked = {"op": asked["op"], "do": asked["do"]}
        assert rig.call(**asked)["reason"].endswith(said)


@pytest.mark.parametrize("place", [math.nan, math.inf, -math.inf, "0", None, True])
def test_nothing_is_nearest_to_a_place_that_is_none(place: Any) -> None:
    array = ElectrodeArray(engine_hello().array)
    assert array.nearest(np.float64(5.1), 0) == 2
    with pytest.raises(Refused, match=r"x_mm=.* finite number"):
        array.nearest(place, 0.0)
    with pytest.raises(Refused, match=r"y_mm=.* finite number"):
        array.nearest(0.0, place)
