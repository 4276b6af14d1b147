"""Several calibrations of one person: opened by a program, told, played, recorded, replayed."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import msgspec
import pytest

from etd import Display
from etd.files.calibration import load_calibration
from etd.files.calibration_folder import CalibrationFolder
from etd.files.pattern import Pattern, PatternFrame
from etd.files.resources import find
from etd.protocol.calibration import Calibration
from etd.protocol.calibration_set import digest_of
from etd.protocol.errors import Refused
from etd.protocol.frame import Polarity
from etd.protocol.messages import Modelled
from etd.protocol.peer import Peer
from etd.record.lines import LeaseBegun
from etd.record.reader import RecordReader
from etd.record.summary import summary_of
from etd.replay.replay import replayed
from etd_hal.compose import open_replay
from gateway_rig import ServedRig
from read_in_place import ReadInPlace
from stepped_daemon import SteppedDaemon, SteppedDisplay

N = 8
CALIBRATION: dict[str, Any] = {
    "participant": "P01", "body_site": "fingertip", "array": "row-4",
    "polarity": "anodic", "width_us": 100, "rate_hz": 60, "returns": "all",
    "date": "2024-05-01", "program": "test",
    "electrode": [{"threshold_ua": 900, "comfortable_ua": 1800, "cap_ua": 2500}] * 4,
}  # fmt: skip


def made(**changes: Any) -> Calibration:
    return msgspec.convert({**CALIBRATION, **changes}, Calibration, strict=False)


@pytest.fixture
def rig() -> Iterator[ServedRig]:
    with ServedRig() as served, Display(address=served.address) as display:
        display.set_calibration("p01-a", made())
        display.set_calibration("p01-c", made(polarity="cathodic"))
        display.set_calibration("p02-c", made(polarity="cathodic", participant="P02"))
        yield served


def test_a_program_opens_with_names_and_the_engine_gets_all(rig: ServedRig) -> None:
    with Display(address=rig.address, calibration=("p01-a", "p01-c")) as display:
        display.arm()
    (opened,) = rig.engine.leases
    assert [(named.name, named.digest) for named in opened.calibrations] == [
        ("p01-a", digest_of(made())),
        ("p01-c", digest_of(made(polarity="cathodic"))),
    ]


def test_one_name_in_a_list_is_that_name(rig: ServedRig) -> None:
    with Display(address=rig.address, calibration=["p01-c"]) as display:
        display.arm()
    (opened,) = rig.engine.leases
    assert [named.name for named in opened.calibrations] == ["p01-c"]


@pytest.mark.parametrize(
    ("names", "code", "said"),
    [
        (("p01-a", "p02-c"), "bad_calibration", "a lease is for one person"),
        (("p01-a", "p01-a"), "bad_calibration", "two calibrations .* anodic"),
        (("p01-a", "nobody"), "not_found", "no calibration 'nobody'"),
        (("p01-a",) * 5, "bad_message", "length <= 4"),
    ],
)
def test_what_is_no_set_is_refused_before_the_engine_hears_of_it(
    rig: ServedRig, names: tuple[str, ...], code: str, said: str
) -> None:
    with (
        Display(address=rig.address, calibration=names) as display,
        pytest.raises(Refused, match=said) as refused,
    ):
        display.arm()
    assert refused.value.code == code
    assert rig.engine.leases == []


@pytest.mark.parametrize("calibration", [(), ("p01-a", 7), 7])
def test_names_are_text(rig: ServedRig, calibration: Any) -> None:
    with pytest.raises(Refused, match="a name is needed, or several"):
        Display(address=rig.address, calibration=calibration)
    with pytest.raises(Refused, match="either calibration, or max_current_ua"):
        Display(
            address=rig.address, calibration=("p01-a", "p01-c"), max_current_ua=500, width_us=100
        )


def test_calibrations_that_do_not_fit_into_a_message_are_refused_and_say_so(tmp_path: Path) -> None:
    count = 256
    electrode = CALIBRATION["electrode"][:1] * count
    returns = [[other for other in range(count) if other != own] for own in range(count)]
    folder = CalibrationFolder(tmp_path, None)
    for name, polarity in (("a", "anodic"), ("c", "cathodic")):
        folder.put(name, made(polarity=polarity, electrode=electrode, returns=returns))
    reader, me = ReadInPlace(tmp_path), Peer(os.geteuid(), ())
    reader.begin(("a", "c"), me)
    with pytest.raises(Refused, match="returns as a ring") as refused:
        reader.result()
    assert refused.value.code == "too_large"
    reader.begin(("a",), me)
    (found,) = reader.result()
    assert found.returns == tuple(map(tuple, returns))


# --- played, recorded, replayed -----------------------------------------------------------------


@pytest.fixture
def daemon() -> Iterator[SteppedDaemon]:
    """Eight electrodes of the modelled finger."""
    with SteppedDaemon("pad-8", is_traced=True) as made_daemon:
        yield made_daemon


def armed_with_both(daemon: SteppedDaemon) -> SteppedDisplay:
    """With a record under way."""
    anodic = load_calibration(find("calibrations", "fake-fingertip-pad-8"))
    cathodic = msgspec.structs.replace(
        anodic,
        polarity="cathodic",
        electrode=tuple(
            msgspec.structs.replace(
                limits,
                threshold_ua=limits.threshold_ua + 200,
                comfortable_ua=limits.comfortable_ua + 200,
                cap_ua=limits.cap_ua + 200,
            )
            for limits in anodic.electrode
        ),
    )
    display = SteppedDisplay(daemon, calibration=("a", "c"))
    display.set_calibration("a", anodic)
    display.set_calibration("c", cathodic)
    display.start_record("r")
    display.arm()
    return display


def wave(*polarities: Any) -> Pattern:
    frames = tuple(
        PatternFrame(duration_ms=300, level=(1.0,) * N, polarity=polarity)
        for polarity in polarities
    )
    return Pattern(electrodes=N, frames=frames)


def test_a_pattern_is_played_by_the_calibration_of_each_frames_polarity(
    daemon: SteppedDaemon, tmp_path: Path
) -> None:
    """And its record has both calibrations, and is fired again as it was."""
    display = armed_with_both(daemon)
    display.play_pattern(wave("anodic", "cathodic", None))
    ways = [phase.is_anodic for phase in daemon.followed.phases() if phase.current_ua > 1_000]
    turns = [way for way, before in zip(ways, [None, *ways], strict=False) if way != before]
    assert turns == [True, False, True]
    display.stop_record()
    path = display.fetch_record("r", tmp_path / "r.jsonl")
    (lease,) = (line for line in RecordReader(path) if isinstance(line, LeaseBegun))
    assert lease.calibration is not None
    assert (lease.calibration_name, lease.calibration_digest) == ("a", digest_of(lease.calibration))
    (other,) = lease.others
    assert (other.name, other.digest) == ("c", digest_of(other.calibration))
    assert list(summary_of(RecordReader(path)).people) == ["fake (calibrations a, c)"]
    stage = open_replay(daemon.loaded.board, electrodes=daemon.loaded.array.outputs())
    found = replayed(path, daemon.loaded, stage)
    stage.backend.close()
    assert found.is_same, (found.differences, found.refused)


def test_a_pattern_with_a_polarity_that_has_no_calibration_is_not_played(
    daemon: SteppedDaemon,
) -> None:
    with pytest.raises(Refused, match=r"biphasic pulses, .* anodic or cathodic ones"):
        armed_with_both(daemon).play_pattern(wave("anodic", "biphasic"))


def test_a_mixed_level_is_felt_everywhere_on_the_modelled_finger() -> None:
    """By the calibrations that the fake ships with, one for each polarity; and it hurts nowhere."""
    kinds: tuple[Polarity, ...] = ("anodic", "cathodic") * 32
    with SteppedDaemon("grid-8x8", body_seed=20_260) as daemon:
        display = SteppedDisplay(daemon, calibration=("a", "c"))
        for name, file in (("a", "fake-fingertip"), ("c", "fake-fingertip-cathodic")):
            display.set_calibration(name, load_calibration(find("calibrations", file)))
        display.arm()
        for way in ("anodic", "cathodic"):
            levels = [float(kind == way) for kind in kinds]
            pattern = Pattern(
                electrodes=64,
                frames=(PatternFrame(duration_ms=1_000, level=tuple(levels), polarity=way),),
            )
            display.play_pattern(pattern, max_rate_hz=20.0)
        for _ in range(2):
            # In the first round there is a report of what was felt before.
            felt, pain = [0.0] * 64, [0.0] * 64
            display.show_levels((0.15,) * 64, polarity=kinds, rate_hz=20.0, ttl_ms=1_000)
            until_ns = daemon.now_ns() + 700_000_000
            while daemon.now_ns() < until_ns:
                _, report = display.receive(0.1) or ("", None)
                if isinstance(report, Modelled):
                    felt = [max(pair) for pair in zip(felt, report.felt, strict=True)]
                    pain = [max(pair) for pair in zip(pain, report.pain, strict=True)]
    assert min(felt) >= 1.0
    assert max(pain) < 1.0
