"""`etd calibrate --fit` as a process: what it adds k to, what is kept, and a lease that lapses."""

from __future__ import annotations

import math
import random
import re
import signal
import statistics
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import msgspec
import pytest
from msgspec.structs import replace

from command_rig import WITHIN_S, CommandRig, Said, command_rig
from engine_scenes import exponent
from etd.calibrate.conditions import Conditions, identity
from etd.calibrate.exponent import Asked
from etd.calibrate.fitting import STATES, FitProgress, electrodes_to_ask
from etd.calibrate.progress import capped, save_progress
from etd.files import resources
from etd.files.calibration import load_calibration, to_toml
from etd.protocol.calibration import Calibration, ElectrodeLimits
from etd_hal.compose import wall_time
from stored_calibrations import exported, import_as
from terminal_rig import AtTerminal

pytestmark = pytest.mark.slow

BASELINE = "fake-fingertip-pad-8"
LIMIT = ("--max-current-ua", "2000")
FIT = ("calibrate", "fake", "--fit", "--baseline", BASELINE, "--as", "K01", *LIMIT)
ON_FAKE = ("--board", "fake", "--array", "pad-8")
#: By how much thresholds went up and down between states, of nobody's skin.
WILD = 1.6


@pytest.fixture
def rig() -> Iterator[CommandRig]:
    with command_rig() as made:
        yield made


def saved(
    rig: CommandRig, criterion_sigma: float, states: int = len(STATES), daemon: str = "fake"
) -> Path:
    """A fit of K01 that is over so far, of a person whose criterion moves so much."""
    baseline = load_calibration(resources.find("calibrations", BASELINE))
    same = set(Conditions.__struct_fields__) & set(type(baseline).__struct_fields__)
    conditions = Conditions(
        **{
            **{key: getattr(baseline, key) for key in same},
            "method": "staircase",
            "electrodes": len(baseline.electrode),
            "pulses": 10,
            "cap_ua": 2_000,
            "baseline": identity(BASELINE, baseline),
        }
    )
    chance, asked, electrodes = random.Random(31), [], electrodes_to_ask(baseline)
    now_s = wall_time().timestamp()
    for state, ohm in enumerate((46e3, 20e3, 44e3, 21e3, 46e3)[:states]):
        moved = math.exp(chance.gauss(0.0, criterion_sigma))
        for place, electrode in enumerate(electrodes):
            at_s = now_s - 2_000.0 + 400.0 * state + 40.0 * place
            threshold_ua = max(20.0, min(2_000.0, 600.0 * moved))
            asked.append(Asked(electrode, state, at_s, threshold_ua, ohm))
    path = rig.folder / "state" / "etd" / daemon / "calibrating" / "K01.fit.json"
    where = f", daemon ipc://{rig.folder}/run/etd/main/control.sock" if daemon == "main" else ""
    made_on = f"kajimoto-hv507 (fake){where}"
    progress = FitProgress(
        conditions=conditions,
        electrodes=electrodes,
        seed=1,
        board="kajimoto-hv507",
        leak_ohm=66_000,
        made_on=made_on,
        states=states,
        asked=asked,
    )
    save_progress(path, progress)
    return path


def test_a_k_that_is_known_to_nobody_is_stored_and_can_be_read_again(rig: CommandRig) -> None:
    """With its interval, so that a refusal can say why."""
    kept, out = saved(rig, WILD), rig.folder / "K01.toml"
    told = rig.run(*FIT, *ON_FAKE, "--out", str(out))
    assert told.status == 0, told.err
    assert "power_law is not for this person" in told.out
    made = load_calibration(out)
    assert made.exponent is not None
    assert made.exponent.high - made.exponent.low > 10.0
    assert made.exponent.board == "kajimoto-hv507"
    assert not kept.exists()
    checked = rig.run("check", str(out))
    assert (checked.status, "power_law is not for this person: k = " in checked.out) == (0, True)


def test_what_was_answered_is_kept_where_nothing_can_be_fitted(rig: CommandRig) -> None:
    path = saved(rig, 0.05)
    progress = msgspec.json.decode(path.read_bytes(), type=FitProgress)
    few = progress.electrodes[:3]
    progress.asked = [one for one in progress.asked if one.state == 0 or one.electrode in few]
    save_progress(path, progress)
    before = path.read_bytes()
    told = rig.run(*FIT, *ON_FAKE, "--out", str(rig.folder / "K01.toml"))
    assert told.status == 1
    assert "3 of 6 electrodes have a threshold in all states so far, or all but 1" in told.err
    assert f"the answers are kept in {path}, and --restart asks all states again" in told.err
    assert path.read_bytes() == before
    assert not (rig.folder / "K01.toml").exists()


def test_a_fit_of_the_day_before_is_not_continued(rig: CommandRig) -> None:
    path = saved(rig, 0.05, states=2)
    progress = msgspec.json.decode(path.read_bytes(), type=FitProgress)
    progress.asked = [
        msgspec.structs.replace(one, at_s=one.at_s - 86_400) for one in progress.asked
    ]
    save_progress(path, progress)
    told = rig.run(*FIT, *ON_FAKE)
    assert told.status == 2
    assert "the last state was over 24 hours ago" in told.err
    assert "--restart" in told.err
    assert path.exists()


def test_k_is_added_to_a_calibration_and_it_is_said_where_there_is_none(rig: CommandRig) -> None:
    with rig.daemon("--array", "pad-8"):
        for where in ((), ON_FAKE):
            told = rig.run("calibrate", "P09", "--fit", *LIMIT, *where)
            assert told.status == 1
            assert "no calibration 'P09'" in told.err
            assert "--fit adds k to a calibration: calibrate first" in told.err
        others = rig.run("calibrate", "P09", "--fit", "--baseline", BASELINE, "--as", "P09", *LIMIT)
        assert others.status == 1
        assert "the baseline has participant fake, this calibration P09: --fit adds k" in others.err
        assert "without a baseline" not in others.err


def test_a_limit_that_few_thresholds_are_below_is_refused_before_anything_is_asked(
    rig: CommandRig,
) -> None:
    told = rig.run(*FIT, *ON_FAKE, "--max-current-ua", "1005")
    assert told.status == 2
    assert "--max-current-ua: 2 electrodes have a threshold below 1005 uA" in told.err


def test_it_says_first_what_damp_skin_may_get_above_the_caps(rig: CommandRig) -> None:
    first, *others = shipped().electrode
    lower = replace(first, comfortable_ua=1_500, cap_ua=1_800)
    asked = ("calibrate", "fake", "--fit", "--baseline", "K02", "--as", "K02", *LIMIT, "--arm")
    said = "in 2 of 5 states, 1 of 6 electrodes may get more than their caps in K02, up to 2000 uA"
    for electrode, is_said in ((first, False), (lower, True)):
        with rig.daemon("--array", "pad-8"):
            import_as(rig, replace(shipped(), electrode=(electrode, *others)), "K02")
            at = AtTerminal(rig, *asked)
            try:
                assert at.command.line() == ""
                at.command.line_with("Then any key", "stdout")
                at.press(b"q")
                assert (said in at.command.ended().err) == is_said
            finally:
                at.close()
            rig.run("calibration", "delete", "K02")


def test_after_a_lease_that_lapsed_it_is_said_what_is_kept(rig: CommandRig) -> None:
    with rig.daemon("--array", "pad-8"):
        at = AtTerminal(rig, *FIT, "--arm")
        try:
            assert at.command.line() == "", "each state stands apart"
            at.command.line_with("Then any key", "stdout")
            at.process.send_signal(signal.SIGSTOP)
            waited = rig.run("status", "--json").answer["status"]
            for _ in range(30):
                if waited["state"] == "SAFE":
                    break
                waited = rig.run("status", "--json").answer["status"]
            assert (waited["state"], waited["last_disarm"]) == ("SAFE", "lapsed")
            at.process.send_signal(signal.SIGCONT)
            at.press(b"n")
            said = at.command.ended()
        finally:
            at.close()
        assert said.status == 1
        assert "states that are over: 0: the same command continues" in said.err


@pytest.mark.parametrize(
    ("says", "ends"),
    [
        ("felt('too_strong')", "stopped (too strong, by a button, a monitor or another program)"),
        ("stop()", "halted by"),
    ],
)
def test_a_button_or_another_program_is_heard_between_two_states(
    rig: CommandRig, says: str, ends: str
) -> None:
    program = f"import etd; etd.Display(max_current_ua=100, width_us=50).{says}"
    with rig.daemon("--array", "pad-8"):
        at = AtTerminal(rig, *FIT, "--arm")
        try:
            assert at.command.line() == "", "each state stands apart"
            at.command.line_with("Then any key", "stdout")
            subprocess.run(
                [sys.executable, "-c", program], env=rig.environment, check=True, timeout=WITHIN_S
            )
            said = at.command.ended()
        finally:
            at.close()
        assert rig.run("status", "--json").answer["status"]["state"] == "HALTED"
    assert said.status == 1, said.err
    assert ends in said.err


def test_what_was_too_strong_in_a_fit_is_taken_from_the_calibration_at_once(
    rig: CommandRig,
) -> None:
    """Whatever becomes of the fit; and the same command continues it."""
    before = replace(shipped(), is_whole_accepted=True)
    asked = ("calibrate", "fake", "--fit", "--baseline", "K02", "--as", "K02", *LIMIT, "--seed=1")
    with rig.daemon("--array", "pad-8"):
        import_as(rig, before, "K02")
        said = too_strong_once(rig, asked)
        assert said.status == 1, said.err
        assert "too strong, so the cap is lower: electrode" in said.err
        assert "K02 is stored so" in said.err
        after = exported(rig, "K02")
        again = AtTerminal(rig, *asked, "--arm")
        try:
            assert again.command.line() == ""
            again.command.line_with("Then any key", "stdout")
        finally:
            again.close()
    was, now = the_lowered(before, after)
    assert now.cap_ua < was.cap_ua
    assert after.is_whole_accepted is None


@pytest.mark.parametrize(("felt", "named"), [(8, ("--electrodes", "0,1,2,3,4,5")), (4, ())])
def test_the_same_command_continues_where_too_strong_has_left_an_electrode_no_room(
    rig: CommandRig, felt: int, named: tuple[str, ...]
) -> None:
    before = shipped()
    unfelt = tuple(replace(one, felt=False) for one in before.electrode[felt:])
    before = replace(before, electrode=(*before.electrode[:felt], *unfelt))
    asked = ("calibrate", "fake", "--fit", "--baseline", "K02", "--as", "K02", *LIMIT, "--seed=1")
    with rig.daemon("--array", "pad-8"):
        import_as(rig, before, "K02")
        said = too_strong_once(rig, (*asked, *named))
        assert "the same command continues" in said.err
        was, now = the_lowered(before, exported(rig, "K02"))
        assert (was.felt, now.felt) == (True, False)
        again = AtTerminal(rig, *asked, *named, "--arm")
        try:
            again.command.line_with("continuing: states that are over: 0")
            assert again.command.line() == ""
            again.command.line_with("Then any key", "stdout")
        finally:
            again.close()
        others = rig.run(*asked, "--electrodes", "0,1,2,3")
    is_of_others = "K02.fit.json: electrodes: it was begun with others"
    assert (is_of_others in others.err) == (felt == 8), others.err


def test_a_calibration_that_a_new_fit_is_to_replace_keeps_its_k_until_then(rig: CommandRig) -> None:
    """Its electrode is lower, no other is as the baseline has it. The baseline is lower too: what
    was too strong is so whichever of the two is used.
    """
    had = replace(shipped(), exponent=exponent(0.6))
    had = replace(
        had, electrode=tuple(replace(one, cap_ua=one.cap_ua - 10) for one in had.electrode)
    )
    asked = ("calibrate", "fake", "--fit", "--baseline", "B", "--as", "K", *LIMIT, "--seed=1")
    with rig.daemon("--array", "pad-8"):
        import_as(rig, shipped(), "B")
        import_as(rig, had, "K")
        said = too_strong_once(rig, asked)
        assert "K is stored so" in said.err
        assert "B is stored so" in said.err
        after, baseline = exported(rig, "K"), exported(rig, "B")
    was, now = the_lowered(had, after)
    assert now.cap_ua < was.cap_ua
    assert after.exponent == had.exponent
    was, now = the_lowered(shipped(), baseline)
    assert now.cap_ua < was.cap_ua


def test_what_was_too_strong_stays_so_in_a_fit_that_was_begun_anew(rig: CommandRig) -> None:
    """Of what has the baseline's threshold: what was calibrated anew since is of another day."""
    first, second, *others = shipped().electrode
    lower = replace(first, cap_ua=first.cap_ua - 500, comfortable_ua=first.threshold_ua)
    of_another_day = replace(
        second, threshold_ua=second.threshold_ua - 10, cap_ua=second.cap_ua - 10
    )
    stored = replace(shipped(), electrode=(lower, of_another_day, *others), is_whole_accepted=True)
    saved(rig, 0.05, daemon="main")
    with rig.daemon("--array", "pad-8"):
        import_as(rig, stored, "K01")
        told = rig.run(*FIT)
        assert told.status == 0, told.err
        made = exported(rig, "K01")
    assert made.electrode == (lower, second, *others)
    assert made.exponent is not None


def test_what_was_too_strong_below_its_threshold_stays_so(rig: CommandRig) -> None:
    first, *others = shipped().electrode
    below = capped(first, first.threshold_ua - 20, first.comfortable_ua)
    assert not below.felt
    saved(rig, 0.05, daemon="main")
    with rig.daemon("--array", "pad-8"):
        import_as(rig, replace(shipped(), electrode=(below, *others)), "K01")
        told = rig.run(*FIT)
        assert told.status == 0, told.err
        assert exported(rig, "K01").electrode == (below, *others)


def test_what_a_run_before_could_not_store_is_stored_before_anything_is_shown(
    rig: CommandRig,
) -> None:
    asked = ("calibrate", "fake", "--fit", "--baseline", "K02", "--as", "K02", *LIMIT, "--seed=1")
    with rig.daemon("--array", "pad-8"):
        import_as(rig, shipped(), "K02")
        (stored,) = rig.folder.rglob("K02.toml")
        too_strong_once(rig, asked)
        lowered = exported(rig, "K02")
        assert lowered != shipped()
        # As where the disk was full.
        stored.write_text(to_toml(replace(shipped(), modelled=True)))
        (progress,) = rig.folder.rglob("K02.fit.json")
        known = msgspec.json.decode(progress.read_bytes(), type=FitProgress)
        same = identity("K02", load_calibration(stored))
        known.conditions = replace(known.conditions, baseline=same)
        save_progress(progress, known)
        again = AtTerminal(rig, *asked, "--arm")
        try:
            assert again.command.line() == ""
            again.command.line_with("Then any key", "stdout")
            assert exported(rig, "K02").electrode == lowered.electrode
        finally:
            again.close()


def shipped() -> Calibration:
    return load_calibration(resources.find("calibrations", BASELINE))


def too_strong_once(rig: CommandRig, asked: tuple[str, ...]) -> Said:
    """What a fit says whose first presentation is too strong, surely, and that is left then."""
    at = AtTerminal(rig, *asked, "--arm")
    try:
        assert at.command.line() == "", "each state stands apart"
        at.command.line_with("Then any key", "stdout")
        # A key that comes before it waits for one is dropped.
        rig.run("status")
        at.press(b"n")
        at.command.line_with("How strong was it?", "stdout")
        at.press(b"t")
        at.command.line_with("Was it so? t again", "stdout")
        at.press(b"t")
        at.command.line_with("How strong was it?", "stdout")
        at.press(b"q")
        return at.command.ended()
    finally:
        at.close()


def the_lowered(before: Calibration, after: Calibration) -> tuple[ElectrodeLimits, ElectrodeLimits]:
    """The one electrode that differs, as it was and as it is."""
    both = zip(before.electrode, after.electrode, strict=True)
    (lowered,) = ((was, now) for was, now in both if was != now)
    return lowered


def test_a_simulated_person_answers_in_the_first_state_without_a_key(rig: CommandRig) -> None:
    at = rig.start(*FIT, *ON_FAKE, "--answers", "simulated", "--trials", "fit.tsv")
    trials = rig.folder / "fit.tsv"
    assert at.line() == "", "each state stands apart"
    assert "state 1 of 5, dry" in at.line()
    while not (trials.exists() and len(trials.read_text().splitlines()) > 2):
        assert at.process.poll() is None
        rig.run("status")
    at.process.send_signal(signal.SIGINT)
    said = at.ended()
    assert said.status == 130, said.err
    assert re.search(r"states that are over: 0[:;].* the same command (continues|asks)", said.err)


@pytest.mark.parametrize(
    ("asked", "why"),
    [
        (("run", "--board", "fake", "--finger", "dry"), "no finger 'dry': one of area, indiff"),
        (("calibrate", "P01", *LIMIT, "--finger", "area"), "--finger, --timeout-factor and"),
        (("run", "--board", "fake", "--board-socket", "x", "--breathing"), "only conducts"),
    ],
)
def test_a_finger_that_cannot_be_is_refused_with_what_can(
    rig: CommandRig, asked: tuple[str, ...], why: str
) -> None:
    told = rig.run(*asked)
    assert told.status == 2
    assert why in told.err


def test_a_daemon_has_the_finger_that_was_named(rig: CommandRig) -> None:
    """What is measured says which: this one resists more, and is the same each time."""
    seen = []
    for finger in ((), ("--finger", "capacitive:3"), ("--finger", "capacitive:3")):
        with rig.daemon("--array", "pad-8", *finger):
            seen.append(statistics.median(rig.run("measure", "--json").answer["resistance_ohm"]))
    assert seen[1] == pytest.approx(seen[2], rel=0.1)
    assert abs(math.log(seen[0] / seen[1])) > 0.2
