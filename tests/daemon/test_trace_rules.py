"""The decoder and the rules of traces: independent of the project, and each rule able to fire."""

from __future__ import annotations

import ast
import copy
import sys
from collections.abc import Callable
from functools import cache
from pathlib import Path

import pytest

import engine_rig
from trace_decoder import Facts, Record, decode, visits
from trace_rules import violations

pytestmark = pytest.mark.slow

TESTS = Path(__file__).parents[1]
REST_US = 200
OURS = {"etd", "etd_hal", "etd_body", "engine_rig"}


def imported(path: Path) -> set[str]:
    found: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found |= {alias.name.partition(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            found.add((node.module or ".").partition(".")[0])
    return found


@pytest.mark.parametrize(
    ("module", "allowed"), [("trace_decoder", set()), ("trace_rules", {"trace_decoder"})]
)
def test_the_decoder_stands_on_the_standard_library_alone(module: str, allowed: set[str]) -> None:
    assert imported(TESTS / f"{module}.py") - set(sys.stdlib_module_names) == allowed


def test_the_search_would_find_the_project_in_a_decoder() -> None:
    assert imported(TESTS / "engine_rig.py") & OURS


@cache
def _trace(board: str, polarity: str) -> tuple[Record, ...]:
    """Armed, a few scans of three electrodes, and the end."""
    rig = engine_rig.make(board)
    rig.open()
    rig.arm()
    count = rig.engine.components.loaded.array.count
    current_ua = [0] * count
    for electrode in (0, 5, 6):
        current_ua[electrode] = 400
    rig.hold(160, current_ua=tuple(current_ua), polarity=polarity, rate_hz=10.0)
    assert rig.close() == ()
    return tuple(rig.trace())


def a_trace(board: str = "kajimoto-hv507", polarity: str = "anodic") -> list[Record]:
    return copy.deepcopy(list(_trace(board, polarity)))


BOARDS = ("kajimoto-hv507", "reference-hv507", "etactilekit-hv513", "feetthrough-relay")


@pytest.mark.parametrize("board", BOARDS)
@pytest.mark.parametrize("polarity", ["anodic", "cathodic", "biphasic", "biphasic_cathodic_first"])
def test_a_trace_of_the_engine_breaks_no_rule(board: str, polarity: str) -> None:
    assert violations(a_trace(board, polarity), REST_US) == []


@pytest.mark.parametrize("board", BOARDS)
def test_the_two_phases_of_a_biphasic_pulse_are_one_visit(board: str) -> None:
    pulses = [
        visit for visit in visits(decode(a_trace(board, "biphasic"))) if visit[0].seq is not None
    ]
    assert {len(visit) for visit in pulses} == {2}
    assert {(first.is_anodic, second.is_anodic) for first, second in pulses} == {(True, False)}


Doctor = Callable[[list[Record]], None]


def index_of(trace: list[Record], **fields: object) -> int:
    """The last event with these fields."""
    for place in range(len(trace) - 1, -1, -1):
        if all(trace[place].get(key) == value for key, value in fields.items()):
            return place
    raise AssertionError(f"no event with {fields}")


def pulse_place(trace: list[Record]) -> int:
    """The transfer that raises the DAC in the last pulse: the second event after `message`."""
    for place in range(len(trace) - 1, 2, -1):
        is_first = trace[place - 2].get("event") == "message"
        if is_first and int(trace[place].get("tx") or "0", 16):
            return place
    raise AssertionError("no pulse")


def line_of(trace: list[Record], name: str) -> int:
    return Facts.of(trace[0]).lines[name]


def insert_in_pulse(*changes: tuple[str, int]) -> Doctor:
    """GPIO changes 3 us after the DAC has left zero."""

    def doctor(trace: list[Record]) -> None:
        place = next(
            place
            for place in range(pulse_place(trace), len(trace))
            if trace[place].get("event") == "cs" and not trace[place]["active"]
        )
        at_ns = trace[place]["t_ns"] + 3_000
        trace[place + 1 : place + 1] = [
            {"t_ns": at_ns + 50 * i, "bus": "gpio", "line": line_of(trace, name), "value": value}
            for i, (name, value) in enumerate(changes)
        ]

    return doctor


def set_last(field: str, value: object, **fields: object) -> Doctor:
    def doctor(trace: list[Record]) -> None:
        trace[index_of(trace, **fields)][field] = value

    return doctor


def change_pulse(**fields: object) -> Doctor:
    def doctor(trace: list[Record]) -> None:
        trace[pulse_place(trace)].update(fields)

    return doctor


def leave_out_the_zero(trace: list[Record]) -> None:
    """The last word of the last pulse repeats its code."""
    place = pulse_place(trace)
    code = trace[place]["tx"]
    done = next(i for i in range(place, len(trace)) if trace[i].get("event") == "done")
    last = max(i for i in range(place, done) if trace[i].get("tx"))
    trace[last]["tx"] = code


def send_33_words(trace: list[Record]) -> None:
    place = index_of(trace, event="done")
    word = {**trace[place - 2], "tx": "0000"}
    t_ns = trace[place - 1]["t_ns"]
    pair = [
        {"t_ns": t_ns, "bus": "spi", "event": "cs", "active": True},
        {**word, "t_ns": t_ns},
        {"t_ns": t_ns, "bus": "spi", "event": "cs", "active": False},
    ]
    trace[place:place] = [dict(event) for event in pair * 32]


def swap_times(trace: list[Record]) -> None:
    trace[-3]["t_ns"], trace[-2]["t_ns"] = trace[-2]["t_ns"] + 1, trace[-3]["t_ns"]


def cut_after_a_pulse(trace: list[Record]) -> None:
    """The trace ends before the discharge."""
    place = pulse_place(trace)
    done = next(i for i in range(place, len(trace)) if trace[i].get("event") == "done")
    del trace[done + 1 :]


def cut_before_the_last_clear(trace: list[Record]) -> None:
    """The trace ends where outputs are blanked but the latch still holds an electrode: behind the
    look at the latch, which leaves none.
    """
    del trace[index_of(trace, bus="engine", event="frame") + 1 :]
    for _ in range(2):
        trace.pop()
        while not (trace[-1].get("line") == line_of(trace, "BL") and trace[-1]["value"] == 0):
            trace.pop()


def hurry(trace: list[Record]) -> None:
    """From the call that un-blanks for the last pulse on, everything happens 100 us sooner."""
    place = index_of(trace, line=line_of(trace, "BL"), value=1)
    for record in trace[place - 1 :]:
        record["t_ns"] -= 100_000


@pytest.mark.parametrize(
    ("what", "doctor", "sentence"),
    [
        ("polarity", insert_in_pulse(("POL", 0)), "POL changes while the DAC is at"),
        ("blanking", insert_in_pulse(("BL", 0), ("BL", 1)), "BL changes while the DAC is at"),
        ("latch", insert_in_pulse(("LE", 1)), "LE changes while the DAC is at"),
        ("clock", insert_in_pulse(("CLK", 1)), "CLK changes while the DAC is at"),
        ("data", insert_in_pulse(("DATA", 1), ("DATA", 0)), "DATA changes while the DAC is at"),
        ("no zero", leave_out_the_zero, "a message that ends with the DAC at"),
        ("33 words", send_33_words, "a message of 33 transfers with data"),
        ("512", set_last("transfers", 512, event="message"), "a message of 512 transfers"),
        ("long delay", change_pulse(delay_us=11), "a delay of 11 us"),
        ("short word", change_pulse(tx="13"), "a word of 8 bits"),
        ("no 16 bits", change_pulse(tx="133000"), "24 bits in one chip select"),
        ("control", change_pulse(tx="d330"), "a word with control bits 11"),
        ("low bits", change_pulse(tx="1331"), "a word with bits where none belong"),
        ("cs held", set_last("cs_change", True, event="transfer"), "that keeps the chip select"),
        ("times", swap_times, "a time before the one before it"),
        ("cut short", cut_after_a_pulse, "a selection is left"),
        ("not cleared", cut_before_the_last_clear, "a selection is left"),
        ("no rest", hurry, "a pulse after a rest of"),
    ],
)
def test_a_doctored_half_bridge_trace_breaks_the_rule(
    what: str, doctor: Doctor, sentence: str
) -> None:
    trace = a_trace()
    doctor(trace)
    assert any(sentence in found for found in violations(trace, REST_US)), what


def test_all_outputs_high_with_the_supply_on_breaks_a_rule() -> None:
    trace = a_trace()
    place = index_of(trace, line=line_of(trace, "BL"), value=0)
    trace.insert(place + 1, {**trace[place], "line": line_of(trace, "POL")})
    found = violations(trace, REST_US)
    assert any("BL 0 with POL 0" in text for text in found)


def test_all_outputs_high_with_the_supply_off_breaks_none() -> None:
    trace = a_trace("reference-hv507")
    pol = {"t_ns": trace[-1]["t_ns"], "bus": "gpio", "line": line_of(trace, "POL"), "value": 0}
    assert violations([*trace, pol], REST_US) == []


def test_current_into_a_chain_that_nobody_filled_breaks_a_rule() -> None:
    trace = a_trace()
    clk = line_of(trace, "CLK")
    kept = [entry for entry in trace[1:] if entry.get("line") != clk]
    found = violations([trace[0], *kept], REST_US)
    assert any("nobody knows the state" in text for text in found)


def test_a_stop_may_come_while_current_flows() -> None:
    trace = a_trace()
    insert_in_pulse(("POL", 1), ("BL", 0))(trace)
    assert violations(trace, REST_US) == []


def test_a_stop_that_leaves_the_supply_on_is_none() -> None:
    trace = a_trace("reference-hv507")
    insert_in_pulse(("POL", 1), ("BL", 0))(trace)
    assert any("BL changes while" in found for found in violations(trace, REST_US))


def test_a_stop_with_the_supply_is_excused_whichever_way_current_flows() -> None:
    for polarity in ("anodic", "cathodic"):
        trace = a_trace("reference-hv507", polarity)
        insert_in_pulse(("POL", 1), ("BL", 0), ("HV", 0))(trace)
        assert violations(trace, REST_US) == []


def relay_copies(trace: list[Record]) -> list[int]:
    le = line_of(trace, "LE")
    return [
        i for i, entry in enumerate(trace) if entry.get("line") == le and entry.get("value") == 1
    ]


def test_both_relays_of_one_electrode_break_a_rule() -> None:
    trace = a_trace("feetthrough-relay")
    # All data high: every stage is on.
    data = line_of(trace, "DATA")
    for record in trace[1:]:
        if record.get("line") == data:
            record["value"] = 1
    assert any("both relays" in found for found in violations(trace, REST_US))


def test_relays_that_make_too_soon_after_breaking_break_a_rule() -> None:
    trace = a_trace("feetthrough-relay")
    place = relay_copies(trace)[-3]
    for record in trace[place:]:
        record["t_ns"] -= 700_000
    assert any(
        "us after others were told to open" in violation for violation in violations(trace, REST_US)
    )


def test_relays_that_make_and_break_at_once_break_a_rule() -> None:
    trace = a_trace("feetthrough-relay")
    first_frame = next(i for i, entry in enumerate(trace) if entry.get("event") == "frame")
    opening = [i for i in relay_copies(trace) if i > first_frame][2]
    trace[opening]["value"] = 0
    assert any("make and break at once" in found for found in violations(trace, REST_US))


def test_current_before_the_relays_have_closed_breaks_a_rule() -> None:
    trace = a_trace("feetthrough-relay")
    place = pulse_place(trace)
    begun = max(i for i in range(place) if trace[i].get("event") == "message")
    for record in trace[begun:]:
        record["t_ns"] -= 500_000
    assert any(
        "before the relays have closed" in violation for violation in violations(trace, REST_US)
    )


def test_relays_left_closed_break_a_rule() -> None:
    trace = a_trace("feetthrough-relay")
    cut_after_a_pulse(trace)
    assert any("relays are left closed" in found for found in violations(trace, REST_US))


def test_a_relay_that_moves_while_current_flows_breaks_a_rule() -> None:
    trace = a_trace("feetthrough-relay")
    insert_in_pulse(("LE", 1), ("LE", 0))(trace)
    assert any("LE changes while" in found for found in violations(trace, REST_US))
