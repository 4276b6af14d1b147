"""`Display` against a real gateway: what an application may say, and what it is told.

Owns: the blocking client from its methods to the engine's end of the link.
"""

from __future__ import annotations

import ast
import math
import os
import signal
import threading
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest

from etd import DaemonGone, Display, FileError, Refused, WrongThread
from etd.client import values
from etd.gateway.server import Gateway
from etd.protocol.calibration import Calibration
from etd.protocol.calibration_set import digest_of
from etd.protocol.link import Answer, ArmBoard, Command, KeepLease, NewFrame, StopNow
from etd.protocol.messages import MAX_MESSAGE_BYTES
from gateway_rig import ServedRig
from scripted_engine import full_answer


@pytest.fixture
def rig() -> Iterator[ServedRig]:
    with ServedRig() as rig:
        yield rig


def display(rig: ServedRig, **extra: Any) -> Display:
    return Display(
        address=rig.address, **{"max_current_ua": 3000, "width_us": 100, "client": "me", **extra}
    )


def test_the_first_script_of_the_readme_works(rig: ServedRig) -> None:
    with display(rig) as d:
        assert d.electrodes == 4
        d.arm()
        d.hold([0, 0.2, 0.4, 1], seconds=0.15)

    levels = [sent.frame.level for sent in rig.engine.frames]
    assert levels[0] == (0, 0.2, 0.4, 1)
    assert levels[-1] == (0, 0, 0, 0), "it ends silent"
    assert len(levels) >= 3, "renewed within its ttl"
    assert [sent.frame.seq for sent in rig.engine.frames] == list(range(1, len(levels) + 1))
    assert type(rig.engine.heard[-1]).__name__ == "CloseLease"


def test_another_thread_is_told_at_once_and_may_stop(rig: ServedRig) -> None:
    with display(rig) as d:
        with ThreadPoolExecutor() as pool:
            with pytest.raises(WrongThread, match="make one in each thread"):
                pool.submit(d.status).result()
            with pytest.raises(WrongThread):
                pool.submit(d.close).result()
            pool.submit(d.stop).result()
        assert isinstance(rig.engine.heard[-1], StopNow)


def test_a_child_of_the_process_is_told_at_once(rig: ServedRig) -> None:
    with display(rig) as d:
        reading, writing = os.pipe()
        child = os.fork()
        if child == 0:
            try:
                d.status()
            except WrongThread as wrong:
                os.write(writing, str(wrong).encode())
            finally:
                os._exit(0)
        os.waitpid(child, 0)
        os.close(writing)
        with open(reading) as said:
            assert "has forked" in said.read()
        assert d.status().state == "SAFE"


def test_whole_numbers_may_come_out_of_a_calculation(rig: ServedRig) -> None:
    with display(rig) as d:
        d.show([0] * 4, width_us=200 / 2, ttl_ms=np.float64(150.0), pulses=3.0)  # type: ignore[arg-type]
        frame = rig.engine.frames[-1].frame
        assert (frame.width_us, frame.ttl_ms, frame.pulses) == (100, 150, 3)
        with pytest.raises(Refused, match="width_us"):
            d.show([0] * 4, width_us=100.5)  # type: ignore[arg-type]


def test_an_unknown_topic_is_refused_with_those_that_there_are(rig: ServedRig) -> None:
    with display(rig) as d, pytest.raises(Refused, match="choose of state") as caught:
        d.telemetry("scans")  # type: ignore[arg-type]
    assert caught.value.code == "bad_message"


def test_nothing_is_opened_until_something_needs_the_lease(rig: ServedRig) -> None:
    with display(rig) as d:
        d.status()
        assert d.facts.board.name == "scripted"
        assert rig.engine.leases == []
        d.show([0] * 4)
        d.show([0] * 4)
        assert len(rig.engine.leases) == 1


@pytest.mark.parametrize(
    "levels",
    [
        [0, 0.5, 1, 0],
        (0, 0.5, 1, 0),
        (x for x in (0, 0.5, 1, 0)),
        np.array([0, 0.5, 1, 0]),
        np.array([0, 0.5, 1, 0], dtype=np.float32),
        [np.float64(0), np.float32(0.5), np.int64(1), 0],
    ],
    ids=["list", "tuple", "generator", "array", "float32", "numpy scalars"],
)
def test_one_number_per_electrode_may_come_in_many_shapes(rig: ServedRig, levels: Any) -> None:
    with display(rig) as d:
        d.show(levels)
    assert rig.engine.frames[0].frame.level == (0, 0.5, 1, 0)


@pytest.mark.parametrize(
    ("bad", "said"),
    [
        ([0, math.nan, 0, 0], r"level\[1\] is nan: a finite number"),
        ([0, 0, math.inf, 0], r"level\[2\] is inf"),
        ([0, "1", 0, 0], r"level\[1\] is the text '1': a number"),
        ("0000", "level is the text '0000': give a list"),
        ([[0, 0], [0, 0]], "2 rows of 2 numbers: row-4 has 1 rows of 4"),
        (np.zeros((2, 2)), "2 rows of 2 numbers: row-4 has 1 rows of 4"),
        (np.zeros((1, 4, 1)), r"level\[0\] is a list: a number is needed"),
        ({4: 1.0}, "there is no electrode 4: 0 to 3"),
        ({"1": 1.0}, "'1' is no electrode: give its number"),
        (0.5, "level is a float: give a list"),
        (None, "level is missing"),
    ],
)
def test_bad_values_are_refused_before_they_are_sent(rig: ServedRig, bad: Any, said: str) -> None:
    with display(rig) as d, pytest.raises(Refused, match=said) as refused:
        d.show(bad)
    assert refused.value.code == "bad_frame"
    assert rig.engine.heard == []


def test_what_the_daemon_refuses_is_raised_with_its_fields(rig: ServedRig) -> None:
    with display(rig) as d:
        with pytest.raises(Refused, match="level has 2 values, the array has 4") as wrong:
            d.show([0, 1])
        with pytest.raises(Refused, match=r"level\[2\] is 2: levels go from 0") as too_much:
            d.show([0, 0, 2, 0])
    assert wrong.value.code == "bad_frame"
    assert (too_much.value.code, too_much.value.electrode) == ("bad_frame", 2)


def test_half_a_microampere_is_no_current() -> None:
    assert values.currents_ua([1.0, 2]) == [1, 2]
    with pytest.raises(Refused, match=r"current_ua\[1\] is 2.5: whole microamperes"):
        values.currents_ua([1, 2.5])


def test_options_reach_the_engine_as_they_were_given(rig: ServedRig) -> None:
    with display(rig) as d:
        reply = d.show_current(
            [100, 0, 0, 0], width_us=[50, 60, 70, 80], polarity="cathodic", rate_hz=np.float64(40),
            returns={"ring_mm": 2.5}, ttl_ms=500, pulses=3, strict=True, tag=7,
        )  # fmt: skip
    sent = rig.engine.frames[0].frame
    assert reply.rate_hz == 60.0
    assert sent.width_us == (50, 60, 70, 80)
    assert (sent.polarity, sent.rate_hz, sent.pulses) == ("cathodic", 40.0, 3)
    assert sent.sent_ns is not None


def test_an_unknown_option_is_refused_by_name(rig: ServedRig) -> None:
    with display(rig) as d, pytest.raises(Refused, match=r"no option 'ttl'; it has .*ttl_ms"):
        d.show([0] * 4, ttl=5)  # type: ignore[call-arg]


def test_a_message_over_the_size_limit_is_refused_with_a_sentence(rig: ServedRig) -> None:
    sets = [[other for other in range(256) if other != electrode] for electrode in range(256)]
    with display(rig) as d, pytest.raises(Refused, match=str(MAX_MESSAGE_BYTES)) as refused:
        d.show([0] * 256, returns=sets)
    assert refused.value.code == "too_large"


def test_without_limits_nothing_is_opened_and_the_refusal_teaches(rig: ServedRig) -> None:
    with (
        Display(address=rig.address) as d,
        pytest.raises(Refused, match=r"Display\(calibration='NAME'\)") as refused,
    ):
        d.arm()
    assert refused.value.code == "limits_missing"
    with pytest.raises(Refused, match="width_us is missing"):
        Display(address=rig.address, max_current_ua=1000)
    assert rig.engine.heard == []


def test_the_daemons_default_calibration_is_what_opens_a_bare_display() -> None:
    with ServedRig(default_calibration="me") as rig, Display(address=rig.address) as d:
        with pytest.raises(Refused, match="no calibration 'me'"):
            d.arm()
        d.set_calibration("me", calibration())
        d.arm()
        (opened,) = rig.engine.leases
        (named,) = opened.calibrations
        assert (named.name, named.digest) == ("me", digest_of(calibration()))
        assert d.calibrations() == ("me",)
        assert d.calibration("me") == calibration()


def calibration() -> Calibration:
    return msgspec.convert(
        {
            "participant": "P01", "body_site": "fingertip", "array": "row-4",
            "polarity": "anodic", "width_us": 100, "rate_hz": 60, "returns": "all",
            "date": "2024-05-01", "program": "test",
            "electrode": [{"threshold_ua": 900, "comfortable_ua": 1800, "cap_ua": 2500}] * 4,
        },
        Calibration,
    )  # fmt: skip


def test_while_arming_takes_its_time_the_lease_is_kept(rig: ServedRig) -> None:
    waiting: list[ArmBoard] = []

    def slow(command: Command | NewFrame) -> Answer | None:
        if isinstance(command, ArmBoard):
            waiting.append(command)
            return None
        if isinstance(command, KeepLease) and waiting:
            rig.engine.say(Answer(ref=waiting.pop().ref))
        return full_answer(command)

    rig.engine.answer = slow
    with display(rig) as d:
        d.arm(timeout_s=60)
        assert any(isinstance(command, KeepLease) for command in rig.engine.heard)
        d.show([0] * 4)


def test_a_lapsed_lease_is_raised_by_show_and_replaced_by_arm(rig: ServedRig) -> None:
    def lapsed(command: Command | NewFrame) -> Answer:
        if isinstance(command, (NewFrame, KeepLease)):
            return Answer(ref=command.ref, error="no_lease", reason="it lapsed")
        return full_answer(command)

    with display(rig) as d:
        d.arm()
        rig.engine.answer = lapsed
        with pytest.raises(Refused, match="it lapsed"):
            d.show([0] * 4)
        with pytest.raises(Refused, match=r"call arm\(\) first"):
            d.keep()
        rig.engine.answer = full_answer
        d.arm()
        d.show([0] * 4)
    assert len(rig.engine.leases) == 2
    assert rig.engine.frames[-1].frame.seq == 1, "seq begins anew with a lease"


def test_the_operator_arms_a_lease_that_is_not_theirs(rig: ServedRig) -> None:
    with Display(address=rig.address) as operator:
        operator.arm_holder()
        operator.stop()
        operator.clear()
    assert [type(command).__name__ for command in rig.engine.heard] == [
        "ArmBoard", "StopNow", "ClearHalt",
    ]  # fmt: skip
    assert isinstance(rig.engine.heard[1], StopNow)


def test_streamed_frames_arrive_without_an_answer(rig: ServedRig) -> None:
    with display(rig) as d:
        for tag in range(20):
            d.stream([0, 0, 0, 1], tag=tag)
        d.stream_current([0, 0, 0, 900], tag=20)
        while d.status().counters.get("superseded", 0) + len(rig.engine.frames) < 21:
            pass
    assert rig.engine.frames[-1].frame.tag == 20
    assert rig.engine.frames[-1].frame.current_ua == (0, 0, 0, 900)


def test_measure_mark_and_status_are_typed(rig: ServedRig) -> None:
    with display(rig) as d:
        assert d.measure().contact == (True, True, False, None)
        assert d.mark(3).marked_ns == 42
        assert d.status().state == "SAFE"
        d.disarm()


def test_telemetry_begins_with_nothing_missed(rig: ServedRig) -> None:
    with display(rig) as d, d.telemetry("refused", timeout_s=60) as reports:
        d.arm()
        d.stream([0, 0])
        topic, report = next(iter(reports))
        assert topic == "refused"
        assert "2 values" in report.reason  # type: ignore[union-attr]
        assert reports.receive(0.01) is None
    with display(rig) as d, d.telemetry() as reports:
        assert reports.receive(60) is not None


def test_silence_of_telemetry_is_raised_when_a_time_was_given(rig: ServedRig) -> None:
    with (
        display(rig) as d,
        d.telemetry("halt", timeout_s=0.05) as reports,
        pytest.raises(DaemonGone, match=r"no telemetry for 0.05 s"),
    ):
        next(iter(reports))


@pytest.mark.parametrize("timeout_s", [math.nan, math.inf, -1, 0, "1", True])
def test_a_timeout_that_is_no_duration_is_refused_wherever_it_is_given(
    rig: ServedRig, timeout_s: Any
) -> None:
    with display(rig) as d:
        for give in (
            d.arm,
            d.arm_holder,
            d.measure,
            d.telemetry,
            lambda timeout_s: display(rig, timeout_s=timeout_s),
        ):
            with pytest.raises(Refused, match="timeout_s="):
                give(timeout_s=timeout_s)
        assert d.status().state == "SAFE"


def test_control_c_ends_a_hold_silent(rig: ServedRig) -> None:
    def interrupt(command: Command | NewFrame) -> Answer:
        if isinstance(command, NewFrame) and command.frame.seq == 2:
            signal.pthread_kill(threading.main_thread().ident or 0, signal.SIGINT)
        return full_answer(command)

    rig.engine.answer = interrupt
    with display(rig) as d:
        with pytest.raises(KeyboardInterrupt):
            d.hold_current([900, 0, 0, 0], seconds=20)
        assert rig.engine.frames[-1].frame.current_ua == (0, 0, 0, 0)


def test_a_client_whose_name_has_control_characters_can_stop(rig: ServedRig) -> None:
    with display(rig, client="me\n\x1b[31m") as named:
        named.stop()
    (stop,) = [said for said in rig.engine.heard if isinstance(said, StopNow)]
    assert stop.client.startswith("'me")
    assert stop.client.isprintable()


def test_why_it_is_stopped_is_told_after_the_name(rig: ServedRig) -> None:
    """In a name's room."""
    with display(rig, client="study" * 12) as named:
        named.stop("the window\nwas closed")
        named.stop("x" * 70)
    said = [one.client for one in rig.engine.heard if isinstance(one, StopNow)]
    names = [ast.literal_eval(one.rpartition(" (user ")[0]) for one in said]
    assert names[0].startswith("studystudy")
    assert names[0].endswith(r"study, the window\nwas closed")
    assert [len(each) for each in names] == [64, 64]


def test_without_an_engine_status_and_stop_still_answer(rig: ServedRig) -> None:
    with display(rig) as d:
        rig.engine.close()
        while d.status().engine != "gone":
            pass
        with pytest.raises(Refused, match="nothing is stimulated"):
            d.stop()
    with display(rig) as d:
        assert d.status().state == "SAFE"
        with pytest.raises(Refused, match="is not running") as refused:
            _ = d.electrodes
        assert refused.value.code == "engine_gone"


def test_an_unanswered_request_is_raised_and_the_next_one_gets_its_own_reply(
    rig: ServedRig,
) -> None:
    rig.engine.answer = lambda command: (
        None if isinstance(command, ArmBoard) else full_answer(command)
    )
    with display(rig) as d:
        # It answers all else: whether it runs is no question.
        with pytest.raises(DaemonGone, match=r"no answer to arm within 0.1 s at .* hangs, or is"):
            d.arm(timeout_s=0.1)
        assert d.show([0] * 4).seq == 1


def test_what_was_said_to_a_daemon_that_is_gone_is_not_delivered_to_the_next(
    rig: ServedRig,
) -> None:
    with display(rig) as d:
        rig.pause()
        rig.gateway.close()
        gone = r"no answer to arm within 0.1 s, and now .* at .*: is the daemon running\?"
        with pytest.raises(DaemonGone, match=gone):
            d.arm_holder(timeout_s=0.1)
        rig.gateway = Gateway(rig.config, rig.running)
        rig.resume()
        d.stop()
    assert [type(command).__name__ for command in rig.engine.heard] == ["StopNow"]


def test_nobody_there_is_told_at_once_and_how(tmp_path: Path) -> None:
    with pytest.raises(DaemonGone, match="there is no socket"):
        Display(address=f"ipc://{tmp_path}/control.sock")


def test_tcp_is_refused_and_ssh_is_named() -> None:
    with pytest.raises(Refused, match=r"authenticated.*by your own ssh: Display\(host="):
        Display(address="tcp://10.0.0.1:5560")
    with pytest.raises(Refused, match=r"TCP is refused.*through ssh"):
        Display(host="tcp://10.0.0.1:5560")
    for address in ("/run/etd/main/control.sock", "ipc://", "ipc:///", ""):
        with pytest.raises(Refused, match="is not an address"):
            Display(address=address)


def test_a_closed_display_says_so(rig: ServedRig) -> None:
    d = display(rig)
    d.close()
    d.close()
    with pytest.raises(DaemonGone, match="was closed"):
        d.status()


def test_a_daemons_name_is_no_path() -> None:
    with pytest.raises(FileError, match=r"'\.\./x'"):
        Display("../x")
