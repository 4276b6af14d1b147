"""What is made of a record's lines: reading up to where it ends, sums, events, a pattern."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import msgspec
import pytest

from etd.files.pattern import pattern_of
from etd.protocol.errors import FileError
from etd.protocol.messages import Halt, Shown
from etd.protocol.outcome import Clamp, Shortfall
from etd.record import lines
from etd.record.events import COLUMNS, sidecar, table
from etd.record.lines import Line
from etd.record.pattern import FramesToPattern
from etd.record.reader import RecordReader
from etd.record.summary import Summary, summary_of
from etd.record.text import lines_of
from record_rows import BEGINNING, END, HEADER, MS, WALL_NS, frame, pulse, stored

LEVELS = {"level": [0.5, 0.0, 0.0, 0.0], "rate_hz": 50.0}


@pytest.fixture
def path(tmp_path: Path) -> Path:
    """A stimulus of two frames, a look, a mark, a pulse that was cut, a note and a halt."""
    return stored(
        tmp_path,
        *BEGINNING,
        frame(1, 1, 100, **LEVELS),
        frame(2, 2, 180, **LEVELS),
        lines.Pulses(rows=(pulse(110, 0, 1, 1_000), pulse(130, 0, 1, 1_200))),
        lines.Pulses(rows=(pulse(190, 0, 2, 1_200), pulse(195, 3, None, 300))),
        frame(3, 3, 240, level=[0.0] * 4),
        frame(4, 4, 500, current_ua=[0, 800, 0, 0], tag=7),
        lines.Asked(
            t_ns=510 * MS, number=5, client="study", uid=1, request={"op": "mark", "tag": 3}
        ),
        lines.Replied(t_ns=511 * MS, number=5, ok=True, reply={"marked_ns": 505 * MS}),
        lines.Pulses(
            rows=(
                pulse(520, 1, 4, 0),
                pulse(540, 1, 4, 600, wanted_ua=800, limited="soft_start"),
            )
        ),
        lines.Note(t_ns=600 * MS, text="a\tremark\n", uid=1),
        lines.Halted(report=Halt(cause="stop", source="study", detail="asked", t_ns=700 * MS)),
        END,
    )


def events(path: Path) -> list[dict[str, str]]:
    header, *rows = (line.split("\t") for line in table(RecordReader(path)))
    assert header == list(COLUMNS) == list(sidecar())
    return [dict(zip(header, row, strict=True)) for row in rows]


def test_events_are_stimuli_marks_notes_and_halts_by_their_onset(path: Path) -> None:
    found = events(path)
    assert [(event["onset"], event["trial_type"]) for event in found] == [
        ("0.110000", "stimulus"),
        ("0.505000", "mark"),
        ("0.540000", "stimulus"),
        ("0.600000", "note"),
        ("0.700000", "halt"),
    ]
    first, mark, second, note, halt = found
    assert (first["duration"], first["pulses"], first["electrodes"]) == ("0.080000", "3", "0")
    assert (first["level"], first["wanted_ua"], first["seq"]) == ("0.5", "n/a", "2")
    assert (first["least_ua"], first["most_ua"], first["charge_nc"]) == ("1000", "1200", "340.0")
    assert first["wall_time"] == "2026-09-21T14:13:20.110+00:00"
    assert (mark["tag"], mark["client"]) == ("3", "study")
    assert (second["wanted_ua"], second["level"], second["tag"]) == ("800", "n/a", "7")
    assert (second["most_ua"], second["limited"]) == ("600", "soft_start")
    assert (second["pulses"], second["withheld"]) == ("1", "1")
    assert note["text"] == "a remark"
    assert "asked" in halt["text"]


def test_onsets_are_told_from_the_beginning_in_the_time_of_a_fake_that_lags(tmp_path: Path) -> None:
    lag = {"wall_ns": WALL_NS, "uncertainty_ns": 100}
    path = stored(
        tmp_path,
        msgspec.structs.replace(HEADER, begun_ns=5_000 * MS),
        lines.Clocks(t_ns=5_000 * MS, clock_lag_us=3_000_000, **lag),
        lines.Note(t_ns=2_500 * MS, text="half a second after the beginning", uid=1),
        lines.Clocks(t_ns=65_000 * MS, clock_lag_us=3_100_000, **lag),
        lines.Note(t_ns=62_000 * MS, text="a minute after it", uid=1),
    )
    assert [event["onset"] for event in events(path)] == ["0.500000", "60.000000"]


def test_the_sums_leave_out_looks_and_pulses_that_were_withheld(path: Path) -> None:
    summary = summary_of(RecordReader(path))
    assert (summary.stimuli, summary.pulses) == (2, 4)
    assert (summary.silent_pulses, summary.withheld) == (1, 1)
    assert {dose.electrode: (dose.pulses, dose.most_ua) for dose in summary.dose} == {
        0: (3, 1_200),
        1: (1, 600),
    }
    assert summary.dose[0].mean_ua == round((900 + 1_100 + 1_100) / 3)
    assert [halt.cause for halt in summary.halts] == ["stop"]
    assert summary.ended == "stopped"
    assert any(line.startswith("HALT") for line in lines_of(summary))


def test_a_record_that_is_torn_anywhere_is_read_up_to_there(path: Path) -> None:
    whole = path.read_bytes()
    ends = [0, *(at + 1 for at, byte in enumerate(whole) if byte == ord("\n"))]
    for at in range(0, len(whole), 97):
        path.write_bytes(whole[:at])
        reader = RecordReader(path)
        if at < ends[1]:
            with pytest.raises(FileError, match=r"(nothing|before anything) was recorded"):
                list(reader)
            continue
        assert len(list(reader)) == sum(end <= at for end in ends[1:])
        assert reader.end is None


def test_what_has_no_end_is_read_no_further_than_a_line_may_be() -> None:
    with pytest.raises(FileError, match=r"line 1: it is no line of a record .*and no end"):
        list(RecordReader(Path("/dev/zero")))


def test_a_record_without_its_last_line_is_told_as_cut_off(tmp_path: Path) -> None:
    summary: Summary = summary_of(RecordReader(stored(tmp_path, *BEGINNING, torn=b'{"kind":"no')))
    assert summary.ended is None
    assert any("CUT OFF" in line for line in lines_of(summary))


@pytest.mark.parametrize(
    ("data", "what"),
    [
        (b'{"kind":"end","t_ns":1,"why":"stopped"}\n', "line 1: it is no header"),
        (lines.encoded(HEADER) + b'{"kind":"unheard"}\n', "line 2"),
        (lines.encoded(HEADER) + b"\xff\xfe\n", "line 2"),
        (lines.encoded(HEADER) + b"[" * 100_000 + b"\n", "line 2"),
        (lines.encoded(HEADER).replace(b'"format":1', b'"format":2'), "at most 1"),
        (lines.encoded(HEADER) + b'{"kind":"pulses","rows":[[1,2]]}\n', "line 2"),
    ],
)
def test_what_is_no_record_is_refused_with_the_place(
    tmp_path: Path, data: bytes, what: str
) -> None:
    path = tmp_path / "r.jsonl"
    path.write_bytes(data)
    with pytest.raises(FileError, match=what):
        list(RecordReader(path))


def test_its_frames_become_a_pattern_that_can_be_played(tmp_path: Path) -> None:
    path = stored(
        tmp_path,
        *BEGINNING,
        frame(1, 1, 100, current_ua=[0, 1_000, 0, 500], rate_hz=50.0),
        lines.Pulses(rows=(pulse(110, 1, 1, 1_000), pulse(210, 1, 1, 1_000))),
        frame(2, 2, 400, current_ua=[500, 0, 0, 0]),
        lines.Pulses(rows=(pulse(510, 0, 2, 500), pulse(560, 0, 2, 500))),
        END,
    )
    made = FramesToPattern(RecordReader(path), str(path))
    assert made.full_ua == 1_000
    pattern, mended = pattern_of(made.pattern, (), "made")
    assert mended == ()
    assert [(it.duration_ms, it.off_ms, it.rate_hz) for it in pattern.frames] == [
        (100, 300, 50.0),
        (50, 0, None),
    ]
    assert [it.level for it in pattern.frames] == [(0.0, 1.0, 0.0, 0.5), (0.5, 0.0, 0.0, 0.0)]


def test_levels_and_currents_do_not_become_one_pattern_unless_one_is_chosen(
    path: Path,
) -> None:
    with pytest.raises(FileError, match=r"1 stimuli in levels and 1 stimuli in currents.*--of"):
        FramesToPattern(RecordReader(path), str(path))
    levels = FramesToPattern(RecordReader(path), str(path), "levels")
    assert (levels.full_ua, levels.others) == (None, 1)
    assert [frame["level"] for frame in levels.pattern["frames"]] == [LEVELS["level"]]
    assert "1 stimuli of the other kind, which was not chosen" in levels.left_out
    currents = FramesToPattern(RecordReader(path), str(path), "currents")
    assert currents.full_ua == 800
    assert [frame["level"] for frame in currents.pattern["frames"]] == [[0.0, 1.0, 0.0, 0.0]]


def test_what_a_pattern_cannot_say_is_told(tmp_path: Path) -> None:
    path = stored(
        tmp_path,
        *BEGINNING,
        frame(1, 1, 100, level=[0.5, 0.0, 0.0, 0.4], rate_hz=[50.0, 9.0, 9.0, 50.0], width_us=60),
        lines.Pulses(rows=(pulse(110, 0, 1, 1_000), pulse(120, 3, 1, 900))),
        frame(2, 2, 400, level=[0.5, 0.4, 0.0, 0.0], rate_hz=[50.0, 9.0, 9.0, 9.0], pulses=3),
        lines.Pulses(rows=(pulse(410, 0, 2, 1_000), pulse(420, 1, 2, 900))),
        END,
    )
    made = FramesToPattern(RecordReader(path), str(path))
    assert [frame.get("rate_hz") for frame in made.pattern["frames"]] == [50.0, None]
    told = sorted(sentence.partition(":")[0] for sentence in made.left_out)
    assert told == ["pulses of 1 stimuli", "rate_hz of 1 stimuli", "width_us of 1 stimuli"]


def slow(
    folder: Path, t_ms: list[int], shown: dict[str, Any], life_ms: int, renewed_ms: int = 0
) -> list[str]:
    """The durations of the events, where one frame has one pulse of electrode 0 at each time, and
    others without a pulse may renew it. Another stimulus comes before.
    """
    asked = sorted({*t_ms, *(range(t_ms[0], t_ms[-1], renewed_ms) if renewed_ms else ())})
    several: list[Line] = []
    for seq, at_ms in enumerate(asked, start=2):
        several.append(frame(seq, seq, at_ms - 5, ttl_ms=life_ms, **shown))
        if at_ms in t_ms:
            several.append(lines.Pulses(rows=(pulse(at_ms, 0, seq, 1_000),)))
    before = frame(1, 1, 10, level=[0.0, 0.0, 0.0, 0.1])
    fired = lines.Pulses(rows=(pulse(20, 3, 1, 1_000),))
    _, *found = events(stored(folder, *BEGINNING, before, fired, *several, END))
    return [event["duration"] for event in found]


def test_a_slow_stimulus_is_one_event(tmp_path: Path) -> None:
    """By the rate that it asked for, and by frames that each came while the one before lived."""
    level = {"level": [0.5, 0.0, 0.0, 0.0]}
    times = [100, 600, 1_100, 1_600]
    assert slow(tmp_path, times, {**level, "rate_hz": 2.0}, 200) == ["1.500000"]
    assert slow(tmp_path, times, {**level, "rate_hz": [2.0, 50.0, 50.0, 50.0]}, 200) == ["1.500000"]
    assert slow(tmp_path, times, level, 600) == ["1.500000"]
    assert slow(tmp_path, times, level, 200, renewed_ms=100) == ["1.500000"]


def test_what_neither_rate_nor_life_explains_is_a_gap(tmp_path: Path) -> None:
    level = {"level": [0.5, 0.0, 0.0, 0.0]}
    apart = ["0.000000"] * 3
    times = [100, 900, 1_700]
    assert slow(tmp_path, times, {**level, "rate_hz": 2.0}, 200) == apart
    assert slow(tmp_path, times, {**level, "rate_hz": 50.0}, 200) == apart
    assert slow(tmp_path, times, {**level, "rate_hz": 50.0}, 200, renewed_ms=400) == apart
    assert slow(tmp_path, times, {**level, "pulses": 1, "rate_hz": 1.0}, 1_000) == apart


def test_a_rate_of_which_only_the_reply_tells_explains_a_gap(tmp_path: Path) -> None:
    asked = {"level": [0.5, 0.0, 0.0, 0.0], "rate_hz": 50.0, "allow_slower": True}
    replies = [lines.Replied(t_ns=1, number=it, ok=True, reply={"rate_hz": 2.0}) for it in (1, 2)]
    path = stored(
        tmp_path,
        *BEGINNING,
        frame(1, 1, 100, **asked),
        replies[0],
        lines.Pulses(rows=(pulse(110, 0, 1, 1_000),)),
        frame(2, 2, 600, **asked),
        replies[1],
        lines.Pulses(rows=(pulse(610, 0, 2, 1_000),)),
    )
    assert [event["duration"] for event in events(path)] == ["0.500000"]


def scans(now_ms: int, *seqs: int, **told: Any) -> lines.Scans:
    shown = tuple(
        Shown(seq=seq, tag=None, begun_ns=0, first_ns=None, last_ns=None, ended=True)
        for seq in seqs
    )
    return lines.Scans(now_ns=now_ms * MS, shown=shown, **told)


@pytest.mark.parametrize("is_told_before", [False, True])
def test_a_stimulus_that_was_withheld_as_a_whole_is_an_event_with_its_reason(
    tmp_path: Path, is_told_before: bool
) -> None:
    """Scans are told before their pulses, or after them."""
    clamp = Clamp(electrode=0, wanted_ua=900, allowed_ua=0, reason="contact_open", limited_by=0)
    other = Clamp(electrode=2, wanted_ua=900, allowed_ua=0, reason="cap", limited_by=2)
    told = scans(
        150,
        1,
        clamped=(clamp, other),
        not_fired=(Shortfall(electrode=3, reason="ledger", pulses=1),),
    )
    rows = (pulse(110, 0, 1, 0, wanted_ua=900), pulse(120, 0, 1, 0, wanted_ua=900))
    due: list[Line] = [lines.Pulses(rows=rows), told]
    if is_told_before:
        due.reverse()
    path = stored(
        tmp_path,
        *BEGINNING,
        frame(1, 1, 100, level=[0.5, 0.0, 0.0, 0.0], tag=4),
        *due,
        frame(2, 2, 500, level=[0.0, 0.6, 0.0, 0.0]),
        lines.Pulses(rows=(pulse(510, 1, 2, 800), pulse(520, 1, 2, 0))),
        scans(530, 2, not_fired=(Shortfall(electrode=1, reason="ledger", pulses=1),)),
        END,
    )
    first, second = events(path)
    assert (first["onset"], first["trial_type"], first["tag"]) == ("0.110000", "stimulus", "4")
    assert (first["electrodes"], first["level"]) == ("0", "0.5")
    assert (first["pulses"], first["withheld"], first["limited"]) == ("0", "2", "contact_open")
    assert (second["pulses"], second["withheld"], second["limited"]) == ("1", "1", "ledger")
    summary = summary_of(RecordReader(path))
    assert (summary.stimuli, summary.unfired_stimuli) == (2, 1)
    assert any(line.startswith("WITHHELD") for line in lines_of(summary))


def test_a_frame_that_was_refused_is_not_what_a_later_one_of_its_number_showed(
    tmp_path: Path,
) -> None:
    refused = lines.Replied(t_ns=116 * MS, number=2, ok=False, reply={"error": "old_seq"})
    path = stored(
        tmp_path,
        *BEGINNING,
        frame(1, 1, 100, **LEVELS),
        frame(2, 1, 105, level=[0.0, 0.9, 0.0, 0.0]),
        refused,
        lines.Pulses(rows=(pulse(120, 0, 1, 1_000),)),
        END,
    )
    assert [event["level"] for event in events(path)] == ["0.5"]


def test_a_record_in_which_there_is_nothing_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "p01.jsonl"
    path.write_bytes(b"")
    with pytest.raises(FileError, match="it is empty"):
        summary_of(RecordReader(path))


def test_of_a_record_without_a_stimulus_there_is_no_pattern(tmp_path: Path) -> None:
    path = stored(tmp_path, *BEGINNING, END)
    with pytest.raises(FileError, match="nothing was fired"):
        FramesToPattern(RecordReader(path), str(path))
