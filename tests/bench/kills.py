"""A thousand kills: what flows, how long until the board is safe, and what the next engine says.

    python tests/bench/kills.py [--kills 1000] [--silences 36] [--part operations|process|silence]
        [--json]

Owns: how many kills there are of each kind, their figures, and the verdict. Must not know: how an
engine is driven (`kills_operations.py`, `kills_engine.py`).

`operations`: on modelled boards, at random operations of the ports, with the stopper and without:
no electrode gets more than one programmed pulse, nothing flows after a kill, a crash is remembered
and does not arm. `process`: a real engine's process on wall-clock ports, killed by SIGKILL at
random moments of a scan: how long until the stopper's process has set the lines, and how long
`etd safe` takes that is started at the same moment, as it would have to without a stopper.
`silence`: such an engine is stopped by SIGSTOP while it is armed and pulses: how long until the
stopper's process has set the lines. It is killed afterwards.

Exit status: 0 as it must be, 1 it is not, 3 the machine does not grant what is needed, or held the
stopper itself up for so long that the figures say nothing.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import signal
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

_TESTS = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(_TESTS)]

from bench import kills_engine, wall_ports  # noqa: E402
from bench.kills_operations import KilledEngines, Lives  # noqa: E402
from bench.wall_scan import BOARD, TRY_STOP  # noqa: E402
from board_process import running_board  # noqa: E402
from campaign.scenes import BOARDS  # noqa: E402
from etd.client import Display, clock  # noqa: E402
from etd.files.paths import CONTROL, address_of  # noqa: E402
from etd.files.resources import find  # noqa: E402
from etd.protocol.errors import DaemonGone, Refused  # noqa: E402
from etd_hal.board_lines import window_ms  # noqa: E402
from etd_hal.boardfile import load_board  # noqa: E402

#: From the kill to lines that are safe.
P50_MS, MOST_MS = 5.0, 20.0
#: From a stop to lines that are safe: beyond the window in which an engine must poll.
SILENCE_MARGIN_MS = 5.0
#: A stopped engine is killed so long after that.
_STOPPED_FOR_S = 0.2
#: A stopper that was kept from its processor for this much says that the machine was busy.
_NOISE_MS = 5.0
_TOLD_EVERY = 50
#: Of what one pulse of the frames has at most: the words' own time is within it.
_MOST_PART = 1.0
_CURRENT_UA, _WIDTH_US, _ELECTRODES = 1_000, 100, 64
_ARMED_WITHIN = 5
_READY_WITHIN_NS = 60_000_000_000
_SEED = 1


@dataclass
class ProcessKills:
    """In ms, a kill each."""

    with_ms: list[float] = field(default_factory=list)
    without_ms: list[float] = field(default_factory=list)
    #: From the stop of an engine to safe lines, and the window in which it had to poll.
    silent_ms: list[float] = field(default_factory=list)
    window_ms: float = 0.0
    #: The longest that a stopper was kept from its next check.
    held_up_ms: float = 0.0
    #: Engines that this machine had halted before, or whose lease it had ended: they tell nothing.
    halted_before: int = 0
    wrong: list[str] = field(default_factory=list)


def operations(kills: int, tell: Any, seed: int = _SEED) -> dict[str, Lives]:
    """By board and whether there was a stopper."""
    found: dict[str, Lives] = {}
    with tempfile.TemporaryDirectory(prefix="etd-kills-") as temporary:
        for board in BOARDS:
            for has_keeper in (True, False):
                name = f"{board}, {'with' if has_keeper else 'without'} the stopper"
                engines = KilledEngines(board, Path(temporary), seed, has_keeper=has_keeper)
                for number in range(kills):
                    if number % _TOLD_EVERY == 0:
                        tell(f"{name}: {number} of {kills}")
                    engines.kill_one()
                found[name] = engines.lives
    return found


def processes(kills: int, tell: Any, seed: int = _SEED, silences: int = 0) -> ProcessKills:
    """So many engines are killed, and so many others stopped. Raises: OSError, TimeoutError where
    the machine does not grant it, DaemonGone where it is too busy for the gateway.
    """
    found, chance = ProcessKills(), random.Random(seed)
    with tempfile.TemporaryDirectory(prefix="etd-kills-") as temporary, ExitStack() as stack:
        folder = Path(temporary)
        library, _ = wall_ports.build(folder)
        (folder / "board").mkdir()
        board = load_board(find("boards", BOARD))
        found.window_ms = window_ms(board.guards)
        safe = stack.enter_context(running_board(board, folder / "board"))
        core = sorted(os.sched_getaffinity(0))[-1]
        script = Path(kills_engine.__file__)
        nursery = stack.enter_context(_process(sys.executable, script, folder, library, str(core)))
        part = ("run", "--part", "gateway", "--name", "kills", "--board", "fake")
        stack.enter_context(_process(sys.executable, "-m", "etd", *part, "--folder", str(folder)))
        engines = _Engines(folder, nursery, chance, found)
        for number in range(kills):
            if number % _TOLD_EVERY == 0:
                tell(f"processes: {number} of {kills}")
            killed_ns = engines.end_one(signal.SIGKILL)
            if killed_ns is None:
                continue
            _make_safe(safe.socket)
            found.without_ms.append((clock.now_ns() - killed_ns) / 1e6)
            _heed_stopper(_told_by_stopper(folder), folder, killed_ns, found)
            engines.wait()
        for number in range(silences):
            if number % _TOLD_EVERY == 0:
                tell(f"silent processes: {number} of {silences}")
            stopped_ns = engines.end_one(signal.SIGSTOP)
            if stopped_ns is None:
                continue
            heed_silence(_told_by_stopper(folder), engines.armed_ns, stopped_ns, found)
            engines.wait()
    return found


@dataclass
class _Engines:
    """One after the other."""

    folder: Path
    nursery: Any
    chance: random.Random
    found: ProcessKills
    #: When the last one was armed.
    armed_ns: int = 0

    def end_one(self, how: signal.Signals) -> int | None:
        """An engine from its start to this signal; when that was. One that was stopped is killed
        once it must have been made safe. None: it did not get so far, and is gone.
        """
        was_left = (self.folder / kills_engine.NOTE).exists()
        self.nursery.stdin.write(b"start\n")
        self.nursery.stdin.flush()
        said = self.nursery.stdout.readline().split()
        if said[:1] != [b"ready"]:
            raise OSError(f"the engine did not come up: {said}")
        pid = int(said[1])
        _wait_for_engine(self.folder)
        address = address_of(self.folder)
        with Display(address=address, max_current_ua=_CURRENT_UA, width_us=_WIDTH_US) as display:
            halt = display.status().halt
            if was_left != (halt is not None and halt.source == "crash"):
                self.found.wrong.append("a crash was not remembered, or one that was none")
            _arm(display, self.folder)
            self.armed_ns = clock.now_ns()
            try:
                display.show_current((_CURRENT_UA,) * _ELECTRODES, rate_hz=10.0, ttl_ms=1_000)
            except Refused:
                self._give_up(pid)
                return None
            clock.sleep_s(self.chance.random() * 0.3)
            ended_ns = clock.now_ns()
            os.kill(pid, how)
            if how == signal.SIGSTOP:
                clock.sleep_s(self.found.window_ms / 1e3 + _STOPPED_FOR_S)
                os.kill(pid, signal.SIGKILL)
        return ended_ns

    def _give_up(self, pid: int) -> None:
        """Of an engine that this machine did not let pulse: its gateway was too late."""
        os.kill(pid, signal.SIGKILL)
        _told_by_stopper(self.folder)
        self.wait()
        self.found.halted_before += 1

    def wait(self) -> None:
        """Until it is gone. Raises: OSError, where it does not end."""
        if self.nursery.stdout.readline() != b"ended\n":
            raise OSError("the engine does not end")


def _arm(display: Display, folder: Path) -> None:
    """Once more where this machine halts it. Raises: OSError, where it does so all the time."""
    for _ in range(_ARMED_WITHIN):
        if display.status().halt is not None:
            display.clear()
        (folder / TRY_STOP).touch()
        while (folder / TRY_STOP).exists():
            clock.sleep_s(0.005)
        try:
            display.arm()
        except Refused as refused:
            why = refused
        else:
            return
    raise OSError(f"the engine does not arm: {why}")


def _wait_for_engine(folder: Path) -> None:
    deadline_ns = clock.now_ns() + _READY_WITHIN_NS
    while clock.now_ns() < deadline_ns:
        if (folder / CONTROL).exists():
            with Display(address=address_of(folder)) as display:
                if display.status().engine == "there":
                    return
        clock.sleep_s(0.02)
    raise TimeoutError("the gateway has found no engine")


def _told_by_stopper(folder: Path) -> dict[str, Any]:
    """What it leaves at its end. Raises: TimeoutError."""
    deadline_ns, ended = clock.now_ns() + _READY_WITHIN_NS, folder / kills_engine.ENDED
    while not ended.exists():
        if clock.now_ns() > deadline_ns:
            raise TimeoutError("the stopper does not end")
        clock.sleep_s(0.005)
    told: dict[str, Any] = json.loads(ended.read_text("ascii"))
    ended.unlink()
    return told


def _heed_stopper(told: dict[str, Any], folder: Path, killed_ns: int, found: ProcessKills) -> None:
    if told["cuts"]:
        found.halted_before += 1
        return
    if not (folder / kills_engine.NOTE).exists():
        found.wrong.append("a kill with the supply on left no note")
    found.with_ms.append((told["safe_ns"] - killed_ns) / 1e6)
    found.held_up_ms = max(found.held_up_ms, told["held_up_ns"] / 1e6)


def heed_silence(told: dict[str, Any], armed_ns: int, stopped_ns: int, found: ProcessKills) -> None:
    """Of an engine that was stopped then: its stopper must have cut before it was killed."""
    cuts_ns = [at_ns for at_ns in told["cut_before_ns"] if at_ns >= armed_ns]
    if not told["is_powered"] or (cuts_ns and cuts_ns[0] < stopped_ns):
        found.halted_before += 1
        return
    found.held_up_ms = max(found.held_up_ms, told["held_up_ns"] / 1e6)
    if not cuts_ns:
        found.wrong.append("an engine that was stopped with the supply on was not cut off")
        return
    found.silent_ms.append((cuts_ns[0] - stopped_ns) / 1e6)


def _make_safe(socket: Path) -> None:
    command = [
        *(sys.executable, "-m", "etd", "safe", "--board", BOARD, "--machine", "pi4"),
        *("--board-socket", str(socket)),
    ]
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)


@contextmanager
def _process(*command: str | Path) -> Iterator[Any]:
    pipe, nothing = subprocess.PIPE, subprocess.DEVNULL
    with subprocess.Popen(command, stdin=pipe, stdout=pipe, stderr=nothing) as process:
        try:
            yield process
        finally:
            process.terminate()


def spread(values: Sequence[float]) -> dict[str, float]:
    """p50, p99 and the largest."""
    ordered = sorted(values) or [0.0]
    at = {"p50": 0.5, "p99": 0.99, "max": 1.0}
    found = {name: ordered[round(part * (len(ordered) - 1))] for name, part in at.items()}
    return {"count": len(values), **found}


def wrong_lives(lives: dict[str, Lives]) -> list[str]:
    """A sentence for each thing that must not be."""
    found = []
    for name, each in lives.items():
        found += [f"{name}: {sentence}" for sentence in each.wrong]
        if each.largest_part > _MOST_PART:
            found.append(f"{name}: {each.largest_part:.2f} of a pulse at one electrode")
        if each.after_pc:
            found.append(f"{name}: {each.after_pc:.0f} pC after a kill")
    return found


def is_late(kills: ProcessKills) -> bool:
    figures = spread(kills.with_ms)
    most_silent_ms = spread(kills.silent_ms)["max"]
    is_slow = figures["p50"] > P50_MS or figures["max"] > MOST_MS
    return is_slow or most_silent_ms > kills.window_ms + SILENCE_MARGIN_MS


def verdict(lives: dict[str, Lives], kills: ProcessKills | None) -> int:
    """The exit status."""
    if wrong_lives(lives) or (kills is not None and kills.wrong):
        return 1
    if kills is None or not is_late(kills):
        return 0
    return 3 if kills.held_up_ms > _NOISE_MS else 1


def _sentences(lives: dict[str, Lives], kills: ProcessKills | None) -> Iterator[str]:
    for name, each in lives.items():
        yield (
            f"{name}: {each.kills} kills in {each.operations} operations, {each.powered} with the"
            f" supply on; the largest charge is {each.largest_part:.2f} of a pulse's,"
            f" {each.after_pc:.0f} pC after a kill"
        )
    yield from (f"WRONG: {sentence}" for sentence in wrong_lives(lives))
    if kills is None:
        return
    for name, values in (("the stopper", kills.with_ms), ("`etd safe` alone", kills.without_ms)):
        told = ", ".join(f"{key} {value:.1f}" for key, value in spread(values).items())
        if values:
            yield f"from a kill to safe lines by {name}, ms: {told}"
    if kills.silent_ms:
        told = ", ".join(f"{key} {value:.1f}" for key, value in spread(kills.silent_ms).items())
        yield f"from a stop of the engine to safe lines by the stopper, ms: {told}"
    yield from (f"WRONG: {sentence}" for sentence in kills.wrong)
    if kills.halted_before:
        yield f"{kills.halted_before} engines were halted by this machine before their kill"
    yield f"a stopper was kept from its next check for {kills.held_up_ms:.1f} ms at most"
    if is_late(kills):
        silent_ms = kills.window_ms + SILENCE_MARGIN_MS
        bound = f"p50 {P50_MS:g} ms, at most {MOST_MS:g} ms; of a stop {silent_ms:g} ms"
        noisy = kills.held_up_ms > _NOISE_MS
        yield f"LATE: the bound is {bound}" + ("; but this machine is busy" if noisy else "")


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="kills", description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--kills", type=int, default=1_000, help="of each kind and board")
    parser.add_argument("--silences", type=int, default=36, help="engines that are stopped")
    parser.add_argument("--part", choices=("operations", "process", "silence"), help="one of them")
    parser.add_argument("--seed", type=int, default=_SEED)
    parser.add_argument("--json", action="store_true", help="the figures as one JSON object")
    args = parser.parse_args(arguments)
    # Ended from outside, it leaves no process behind.
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(143))

    def tell(sentence: str) -> None:
        begins, ends = ("\r", "\033[K") if sys.stderr.isatty() else ("", "\n")
        print(f"{begins}{sentence}{ends}", end="", file=sys.stderr, flush=True)

    lives = operations(args.kills, tell, args.seed) if args.part in (None, "operations") else {}
    kills = None
    if args.part != "operations":
        killed = 0 if args.part == "silence" else args.kills
        silences = 0 if args.part == "process" else args.silences
        try:
            kills = processes(killed, tell, args.seed, silences)
        except (OSError, TimeoutError, DaemonGone) as error:
            print(f"processes cannot be killed here: {error}", file=sys.stderr)
            return 3
    if args.json:
        print(json.dumps(_figures(lives, kills)))
    else:
        print("\n".join(_sentences(lives, kills)))
    return verdict(lives, kills)


def _figures(lives: dict[str, Lives], kills: ProcessKills | None) -> dict[str, Any]:
    """Two tables, and what there is to say of the second."""
    found: dict[str, Any] = {}
    if lives:
        found["at_random_operations"] = [
            {"engine_of": name} | asdict(each) for name, each in lives.items()
        ]
    if kills is not None:
        measured = {
            "the stopper": kills.with_ms,
            "etd safe alone": kills.without_ms,
            "the stopper, of an engine that is stopped": kills.silent_ms,
        }
        found["processes_ms_until_safe"] = [
            {"made_safe_by": name} | spread(values) for name, values in measured.items() if values
        ]
        found["window_ms"] = kills.window_ms
        found["stopper_held_up_ms"] = kills.held_up_ms
        found["halted_before_the_kill"] = kills.halted_before
        found["wrong"] = kills.wrong
    return found


if __name__ == "__main__":
    sys.exit(main())
