"""One board file made live: select, fire, discharge, supply, heartbeat, stop lines, safe_off.

Owns: the order of the calls of a pulse, the rest after it, edges of stops and trigger, and the way
to the safe state.
Must not know: frames, limits of persons, electrodes: it knows output numbers only.

Everything that fires goes through the guard's ports. `safe_off` and `blank_now` use the
bare ports: they can only switch off, and must work when the guard's picture is lost.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial

from etd_hal.bench import StopName
from etd_hal.board_lines import edge_of, safe_changes, stop_lines, window_ms
from etd_hal.boardfile import BoardFile, MachineFile, Relays
from etd_hal.chips.codec import Codec
from etd_hal.chips.hv507 import HalfBridgeSwitch
from etd_hal.chips.relay595 import RelaySwitch
from etd_hal.cutlatch import WINDOW_NS, CutLatch
from etd_hal.errors import BoardFault
from etd_hal.guard import Guard
from etd_hal.phase import Pulse, PulseResult
from etd_hal.ports import Changes, Clock, Gpio, Message, Spi
from etd_hal.selection import Selection, Selections, Switch
from etd_hal.source_rules import IDLE_MOST_V, SourceRules
from etd_hal.speeds import Speeds
from etd_hal.switch_shadow import Approval, Prepulse
from etd_hal.timing import Timing, fitted, pulse_message, zero_message

#: How many pulses are kept, each with all that was made of its message (some 5 kB); beyond that the
#: oldest is dropped.
_MAX_REMEMBERED = 2_048
_Key = tuple[int, int, Prepulse | None]


class Board:
    """See the module. Made of a board file and the ports of a backend."""

    def __init__(
        self,
        file: BoardFile,
        machine: MachineFile,
        codec: Codec,
        spi: Spi,
        gpio: Gpio,
        clock: Clock,
    ) -> None:
        """`codec` is that of the file's DAC and ADC."""
        self.file = file
        self.machine = machine
        self._codec = codec
        self._clock = clock
        self._bare_spi, self._bare_gpio = spi, gpio
        #: Shared with the stopper.
        self.cut = CutLatch()
        self.cut.words[WINDOW_NS] = window_ms(file.guards) * 1_000_000
        #: The levels of the safe state, in one call; all that the stopper ever sets.
        self.safe_changes = safe_changes(file)
        self.guard = Guard(file, machine, spi, gpio, clock, self.cut, self.safe_changes)
        self.switch = _switch(file, self.guard.gpio, clock)
        self._selections = Selections(file)
        self._zero = zero_message(codec)
        # Held, and so kept prepared: the way to the safe state lays nothing out.
        spi.prepare(self._zero)
        #: In the order in which they were made, by the present timing.
        self._pulses: dict[_Key, Pulse] = {}
        self._speeds: Speeds[_Key, Pulse] = Speeds(machine, codec, self._time_message)
        self._timing: Timing | None = None
        self._rest_until_ns = 0
        self._heartbeat_level = 0
        self._is_supply_on = file.guards.hv_enable == "absent"
        self._rest_ns = file.rest_us * 1_000
        self._node_v = file.source.node_uv_per_code / 1_000_000
        self.rules = SourceRules.of(file.source)
        self._stop_lines = stop_lines(file.guards)
        self._stop_names = {line: name for name, line in self._stop_lines.items()}
        self._trigger, self._too_strong = edge_of(file.trigger), edge_of(file.too_strong)
        self._triggers_ns: list[int] = []
        self._presses_ns: list[int] = []

    # --- what the board can do -------------------------------------------------------------

    def selection(self, output: int, returns: tuple[int, ...] | None) -> Selection:
        """One output against `returns`, or against all others (None).

        Raises: CannotSelect, where the board has no open state, or an output is not there.
        """
        return self._selections.selection(output, returns)

    def pulse(self, current_ua: int, width_us: int, prepulse: Prepulse | None = None) -> Pulse:
        """The largest code not above `current_ua`, the widest shape not above `width_us`; and the
        same for a prepulse. A prepulse that is not a DAC step below its pulse, or has no current,
        is left out: the pulse is then what it would be without.
        """
        key = (current_ua, width_us, prepulse)
        pulse = self._pulses.get(key)
        if pulse is None:
            if len(self._pulses) >= _MAX_REMEMBERED:
                del self._pulses[next(iter(self._pulses))]
            pulse = self._pulses[key] = self._new_pulse(current_ua, width_us, prepulse)
        return pulse

    def _new_pulse(self, current_ua: int, width_us: int, prepulse: Prepulse | None) -> Pulse:
        source = self.file.source
        code = source.code_for(current_ua)
        before = 0 if prepulse is None else source.code_for(prepulse.current_ua)
        if prepulse is None or not 0 < before < code:
            before = 0
            shape = self.timing.shape(width_us)
        else:
            shape = self.timing.two_steps(prepulse.width_us, width_us)
        message = pulse_message(self._codec, code, shape, before)
        # Prepared here, because a pulse is chosen while the one before it rests.
        self.guard.spi.prepare(message)
        planned_ns = int(shape.duration_us * 1_000)
        commanded_us = round(shape.width_us, 2)
        commanded_ua, before_ua = (int(source.current_of(each)) for each in (code, before))
        return Pulse(commanded_ua, code, shape, message, planned_ns, commanded_us, before_ua)

    # --- timing ----------------------------------------------------------------------------

    @property
    def timing(self) -> Timing:
        """Raises: BoardFault before the first calibration."""
        if self._timing is None:
            raise BoardFault("timing", "not calibrated", "a calibration at start")
        return self._timing

    def calibrate(self, meanwhile: Callable[[], None] = lambda: None) -> Timing:
        """Time messages at DAC code 0, for 20 to 80 ms, and check the result. `meanwhile` is called
        before each message. Raises: BoardFault, BusError.
        """
        self._timing, self._pulses = self._speeds.calibrate(meanwhile)
        return self._timing

    def time_messages(self) -> Timing:
        """What a calibration would find, plausible or not. Raises: BusError, GuardRefusal."""
        return fitted(self._time_message, self._codec)

    def recognize_timing(self, meanwhile: Callable[[], None] = lambda: None) -> bool:
        """Use a timing that held before, if one holds now: in a millisecond. Raises: BusError."""
        found = self._speeds.recognize(meanwhile)
        if found is not None:
            self._timing, self._pulses = found
        return found is not None

    @property
    def min_width_us(self) -> int:
        """The shortest pulse: one word. Raises: BoardFault before the first calibration."""
        return math.ceil(self.timing.word_us)

    def widest_us(self, prepulse_us: int = 0) -> int:
        """The widest pulse that the guard lets pass on this machine in its worst case, with such a
        prepulse included; at most the board's own maximum. Raises: BoardFault before the first
        calibration, or if there is none at all.
        """
        shortest_us = prepulse_us + math.ceil(self.timing.word_us)
        for width_us in range(self.file.maxima.width_us, shortest_us - 1, -1):
            if self.guard.lets_width_pass(self._form(prepulse_us, width_us - prepulse_us)):
                return width_us
        raise BoardFault("widest pulse", "none that the guard lets pass", "one word at least")

    def _form(self, prepulse_us: int, width_us: int) -> Message:
        """A message of this shape, with any code."""
        if not prepulse_us:
            return pulse_message(self._codec, 1, self.timing.shape(width_us))
        return pulse_message(self._codec, 2, self.timing.two_steps(prepulse_us, width_us), 1)

    def _time_message(self, message: Message) -> int:
        self.guard.spi.transfer(message)
        return self.guard.spi.ended_ns - self.guard.spi.begun_ns

    # --- one pulse -------------------------------------------------------------------------

    def prepare(self, selection: Selection, whole: bool = False) -> None:
        """During the rest before: shift the next selection in. Raises: BusError, BoardFault."""
        self.switch.prepare(selection, whole)

    def connect(self, selection: Selection, is_anodic: bool) -> None:
        """Wait out the rest, then connect; relays close only if nothing flows while all are open.

        Raises: BusError, GuardRefusal; BoardFault for a current with the DAC at zero.
        """
        self._clock.sleep_until_ns(self._rest_until_ns)
        if self.switch.can_choose_returns:
            self._check_open_relays()
        self.switch.connect(selection, is_anodic)

    def flip(self, selection: Selection, is_anodic: bool) -> None:
        """Between the phases of a biphasic pulse. Raises: as `connect`."""
        if self.switch.can_choose_returns:
            self._check_open_relays()
        self.switch.flip(selection, is_anodic)

    def _check_open_relays(self) -> None:
        """With all relays open the skin is off the node: charge that it holds cannot be taken for
        a current, and a current can be told before it reaches skin.
        """
        self.switch.release()
        fault = self.rules.idle_fault(self.node_v(), "with all relays open")
        if fault is not None:
            raise fault

    def node_v(self) -> float:
        """What the node reads now, with the DAC at zero. Raises: BusError, BoardFault."""
        return self.node_code() * self._node_v

    def node_code(self) -> int:
        """The same as the ADC's code."""
        return self._codec.code_of(self.guard.spi.transfer(self._zero)[0])

    def send(self, pulse: Pulse, approval: Approval) -> tuple[bytes, ...]:
        """Send one phase, of which the limits let through no more than `approval`. Returns what
        came back, for `result`.

        Raises: GuardRefusal (nothing was sent); BusError (make safe at once); BoardFault (the
        outputs are cut off, and nothing was sent).
        """
        self.guard.approve(approval)
        return self.guard.spi.fire(pulse.message, pulse.planned_ns)

    @property
    def sent_ns(self) -> int:
        """When the last message began."""
        return self.guard.spi.begun_ns

    def result(self, pulse: Pulse, received: tuple[bytes, ...]) -> PulseResult:
        """The result of the message that was sent last. Raises: BoardFault (what came back is no
        sample).
        """
        spi, code_of, node_v = self.guard.spi, self._codec.code_of, self._node_v
        begun_ns, ended_ns = spi.begun_ns, spi.ended_ns
        return PulseResult(
            begun_ns,
            ended_ns,
            ended_ns - begun_ns - pulse.planned_ns,
            code_of(received[0]) * node_v,
            code_of(received[-1]) * node_v,
            code_of(received[2 if pulse.prepulse_ua else 1]) * node_v,
        )

    def fire_unloaded(self, pulse: Pulse, current_ua: int, width_us: int) -> PulseResult:
        """Send a probe after `isolate`: into the node alone. Raises: as `send` and `result`."""
        approval = Approval(0, 0, current_ua, width_us, is_blanked=True)
        return self.result(pulse, self.send(pulse, approval))

    @property
    def can_fire_unselected(self) -> bool:
        """Relays have no blanking: `fire_unloaded` tells the same of them."""
        return isinstance(self.switch, HalfBridgeSwitch)

    def fire_unselected(self, pulse: Pulse, current_ua: int, width_us: int) -> PulseResult:
        """Send a probe after `isolate`, un-blanked: into the node alone, unless the latch has not
        taken over that none is selected. Then `discharge`. Raises: as `send` and `result`.
        """
        if isinstance(self.switch, HalfBridgeSwitch):
            self.switch.expose()
        ground = (1 << self.file.switch.outputs) - 1
        received = self.send(pulse, Approval(0, ground, current_ua, width_us))
        self.discharge()
        return self.result(pulse, received)

    def discharge(self) -> None:
        """All electrodes on ground, for at least the board's rest from now on."""
        self.switch.discharge()
        self._rest_until_ns = self._clock.now_ns() + self._rest_ns

    def release(self) -> None:
        """After the last pulse of a scan: wait out the rest, leave nothing connected."""
        if self.switch.can_choose_returns:
            self._clock.sleep_until_ns(self._rest_until_ns)
        self.switch.release()

    def isolate(self, whole: bool = False) -> None:
        """The same, with no output selected either: the node has its leak alone as a load. With
        `whole` the whole chain is rewritten for it. Raises: BusError, BoardFault.
        """
        if self.switch.can_choose_returns:
            self._clock.sleep_until_ns(self._rest_until_ns)
        self.switch.isolate(whole)

    # --- supply, heartbeat, lines ----------------------------------------------------------

    @property
    def is_supply_on(self) -> bool:
        """Whether the supply may be on: from the call that requests it until a call has switched it
        off (always, where the board has no enable line).
        """
        return self._is_supply_on

    def supply_on(self) -> None:
        """Where the board has an enable line. Raises: BusError."""
        # Before the call: a call that fails may have moved the line.
        self._is_supply_on = True
        enable = self.file.guards.hv_enable
        if enable != "absent":
            self.guard.gpio.set(((enable.line, enable.on),))

    def supply_off(self) -> None:
        """Where the board has an enable line. Raises: BusError."""
        enable = self.file.guards.hv_enable
        if enable != "absent":
            self.guard.gpio.set(((enable.line, 1 - enable.on),))
            self._is_supply_on = False

    def beat(self) -> None:
        """One edge for the monostable that gates the supply. Raises: BusError."""
        heartbeat = self.file.guards.heartbeat
        if heartbeat != "absent":
            self._heartbeat_level = 1 - self._heartbeat_level
            self.guard.gpio.set(((heartbeat.line, self._heartbeat_level),))

    @property
    def heartbeat_level(self) -> int:
        """The level at which the last beat left the line."""
        return self._heartbeat_level

    def sync(self) -> bool:
        """A pulse on the SYNC line; False where the board has none. Raises: BusError."""
        line = self.file.sync_line
        if line == "absent":
            return False
        self.guard.gpio.set(((line, 1),))
        self.guard.gpio.set(((line, 0),))
        return True

    def stops(self) -> dict[StopName, bool]:
        """For each stop line: whether it is open (pressed, or unplugged)."""
        lines = self._stop_lines.items()
        return {name: self._bare_gpio.get(line) == 0 for name, line in lines}

    def stop_edges(self, with_trigger: bool = False) -> tuple[tuple[StopName, bool], ...]:
        """(which, whether it opened) since the last call, oldest first. Never blocks. A read gives
        the edges of all inputs: those of the trigger are kept for `take_triggers` if asked for, the
        presses of the wearer's button for `take_presses`.
        """
        names, too_strong = self._stop_names, self._too_strong
        edges = self._bare_gpio.edges() if names or with_trigger or too_strong else ()
        if not edges:
            return ()
        if with_trigger:
            found = [edge.t_ns for edge in edges if (edge.line, edge.value) == self._trigger]
            self._triggers_ns += found
        if too_strong is not None:
            found = [edge.t_ns for edge in edges if (edge.line, edge.value) == too_strong]
            self._presses_ns += found
        return tuple((names[edge.line], edge.value == 0) for edge in edges if edge.line in names)

    def take_triggers(self) -> list[int]:
        """When the edges of the trigger came that were read, oldest first; each is given once, by
        the kernel's time (CLOCK_MONOTONIC).
        """
        found, self._triggers_ns = self._triggers_ns, []
        return found

    def take_presses(self) -> list[int]:
        """The same of the wearer's button that says *too strong*; as often as it bounced."""
        found, self._presses_ns = self._presses_ns, []
        return found

    # --- the safe state --------------------------------------------------------------------

    def blank_now(self) -> None:
        """The GPIO half of `safe_off`: one call, which the stopper may make too, also during an SPI
        message. Raises: BusError.
        """
        self._bare_gpio.set(self.safe_changes)

    def safe_off(self) -> tuple[str, ...]:
        """Outputs off, DAC at zero, nothing selected, and verified. Never raises.

        Returns what did not work, as sentences; every step is tried even if one before it failed.
        If all steps worked, the cuts until now are over. May be called in the middle of a pulse.
        """
        cuts = self.cut.see()
        not_blanked = _tried(self.blank_now)
        not_zero = _tried(self._zero_dac)
        if not_blanked is None:
            not_blanked = _tried(self._check_blanked)
        if not_blanked is None:
            self._is_supply_on = self.file.guards.hv_enable == "absent"
        # The state of the lines after a failed call is not known.
        deselect = partial(self._deselect, self.safe_changes if not_blanked is None else ())
        verify: tuple[Callable[[], None], ...] = (self._check_node, deselect)
        if self.switch.can_choose_returns:
            # Until its relays open, charged skin stays on the node and looks like current.
            verify = (deselect, self._check_node)
        tried = (not_blanked, not_zero, *(_tried(step) for step in verify))
        self._rest_until_ns = self._clock.now_ns() + self._rest_ns
        problems = tuple(problem for problem in tried if problem)
        if not problems:
            self.cut.ended = cuts
        return problems

    def _check_blanked(self) -> None:
        """By the pins: a call that succeeds proves nothing of what drives a line from outside."""
        for line, level in self.safe_changes:
            found = self._bare_gpio.get(line)
            if found != level:
                (name, *_) = [at for at, one in self.file.used_lines().items() if one == line]
                raise BoardFault(f"{name} (GPIO {line}) when read back", f"{found}", f"{level}")

    def _zero_dac(self) -> None:
        self._bare_spi.transfer(self._zero)

    def _deselect(self, levels: Changes) -> None:
        self.guard.permit(0)
        self.guard.reset(levels)
        self.switch.reset()
        self.guard.gpio.is_making_safe = True
        try:
            self.switch.clear()
        finally:
            self.guard.gpio.is_making_safe = False

    def _check_node(self) -> None:
        node_v = self._codec.code_of(self._bare_spi.transfer(self._zero)[0]) * self._node_v
        if node_v > IDLE_MOST_V:
            raise BoardFault("node with the DAC at zero", f"{node_v:.0f} V", f"{IDLE_MOST_V} V")


def _tried(step: Callable[[], None]) -> str | None:
    try:
        step()
    except Exception as error:  # noqa: BLE001 - the way to the safe state stops for nothing
        return str(error)
    return None


def _switch(file: BoardFile, gpio: Gpio, clock: Clock) -> Switch:
    readback = None if file.guards.readback == "absent" else file.guards.readback
    if isinstance(file.switch, Relays):
        return RelaySwitch(gpio, clock, file.switch, readback)
    return HalfBridgeSwitch(gpio, file.switch.lines, file.switch.outputs, readback)
