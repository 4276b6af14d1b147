"""Whatever two clients, the world and the machine do, in any order, the daemon keeps its promises.

Owns: which steps there are. What must hold after each is in `two_clients.py`. For longer stories
and more of them: make test-models ARGS='-k two_clients --hypothesis-profile=long'.
"""

from __future__ import annotations

from typing import Any

from hypothesis import HealthCheck, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, precondition, rule

from engine_scenes import opened_to
from etd_hal.bench import StopName
from etd_hal.fake import faults
from two_clients import ELECTRODES, OF_LEASE, TwoClients

#: None of them changes what current flows: what others let through is the campaign's.
FAULTS = (
    faults.SpiError(at_transfer=0),
    faults.SpiShort(),
    faults.RailOff(0.5),
    faults.RailOff(1.3),
    faults.AdcStuck(0),
    faults.AdcStuck(4095),
    faults.MisoStuck(1),
    faults.MonitorStuck(rail_v=300.0),
)
who = st.integers(0, 1)
currents_ua = st.sampled_from((0, 0, 100, 400, 1_000, 3_000))
frames = st.fixed_dictionaries(
    {
        "current_ua": st.lists(currents_ua, min_size=ELECTRODES, max_size=ELECTRODES),
        "width_us": st.sampled_from((50, 100, 200)),
        "rate_hz": st.sampled_from((5.0, 20.0, 60.0, 120.0)),
        "polarity": st.sampled_from(("anodic", "cathodic", "biphasic")),
        "ttl_ms": st.sampled_from((1, 50, 200, 1_000)),
    },
    optional={
        "pulses": st.integers(1, 3),
        "allow_slower": st.booleans(),
        "strict": st.booleans(),
        "account": st.just(True),
        "preview": st.just(True),
    },
)
lines = st.sampled_from(("emergency_stop", "wearer_stop"))


class Stories(RuleBasedStateMachine):
    """Each rule is a step of one of those who have a hand in it."""

    def __init__(self) -> None:
        super().__init__()
        self.daemon = TwoClients()
        self.is_over = False

    def teardown(self) -> None:
        self.daemon.end()

    @initialize(is_armed=st.booleans(), first=who, frame=frames)
    def begin(self, is_armed: bool, first: int, frame: dict[str, Any]) -> None:
        """Half of all stories begin with an armed board, and a person who has felt a lot."""
        if is_armed:
            self.open(first, 1_000, 100)
            self.press("wearer_stop")
            self.release("wearer_stop")
            self.ask(first, "arm")
            self.wait(700)
            opened_to(self.daemon.rig, 3_000)
            self.show(first, {**frame, "preview": False}, False, 4)

    @rule(who=who, most_ua=st.sampled_from((300, 1_000)), width_us=st.sampled_from((50, 100)))
    def open(self, who: int, most_ua: int, width_us: int) -> None:
        limits = {"max_current_ua": most_ua, "width_us": width_us}
        self.daemon.ask(who, "open", client=f"client {who}", limits=limits)

    @rule(who=who, op=st.sampled_from(("arm", "hello", "status", "clear", "arm", "clear")))
    def ask(self, who: int, op: str) -> None:
        self.daemon.ask(who, op)

    @rule(who=who, op=st.sampled_from(OF_LEASE))
    def ask_of_lease(self, who: int, op: str) -> None:
        self.daemon.ask(who, op)

    @rule(who=who, seq=st.integers(0, 5))
    def ask_for_an_account(self, who: int, seq: int) -> None:
        """Answered when the frame is over."""
        self.daemon.ask(who, "account", lease=self.daemon.clients[who].lease, seq=seq)

    @rule(who=who)
    def take_the_others_lease(self, who: int) -> None:
        self.daemon.ask(who, "keep", lease=self.daemon.clients[1 - who].lease)

    @rule(who=who, frame=frames, is_streamed=st.booleans(), repeats=st.integers(1, 4))
    def show(self, who: int, frame: dict[str, Any], is_streamed: bool, repeats: int) -> None:
        for _ in range(repeats):
            self.daemon.frame(who, who, is_streamed, frame)
            self.daemon.run(40)

    @rule(who=who, frame=frames, is_streamed=st.booleans())
    def show_with_the_others_lease(
        self, who: int, frame: dict[str, Any], is_streamed: bool
    ) -> None:
        self.daemon.frame(who, 1 - who, is_streamed, frame)

    @rule(who=who)
    def stop(self, who: int) -> None:
        self.daemon.stop(who)

    @rule(who=who, electrodes=st.one_of(st.none(), st.just([0])))
    def feel_too_much(self, who: int, electrodes: list[int] | None) -> None:
        self.daemon.ask(who, "felt", answer="too_strong", electrodes=electrodes)

    @rule(duration_ms=st.sampled_from((1, 10, 50, 300, 700, 1_200)))
    def wait(self, duration_ms: int) -> None:
        self.daemon.run(duration_ms)

    @rule(duration_ms=st.sampled_from((2, 30, 260, 1_500)))
    def stall(self, duration_ms: int) -> None:
        self.daemon.stall(duration_ms)

    @rule(line=lines)
    def press(self, line: StopName) -> None:
        self.daemon.press(line)

    @rule(line=lines)
    def release(self, line: StopName) -> None:
        self.daemon.release(line)

    @rule(fault=st.sampled_from(FAULTS))
    def put_in(self, fault: faults.Fault) -> None:
        self.daemon.put_in(fault)

    @rule()
    @precondition(lambda self: not self.daemon.judge.is_whole)
    def mend(self) -> None:
        self.daemon.mend()

    @rule(who=who)
    def come_again(self, who: int) -> None:
        self.daemon.come_again(who)

    @rule()
    def restart_the_gateway(self) -> None:
        self.daemon.gateway_again()


# A quarter of what the profile has: a story has many steps.
Stories.TestCase.settings = settings(
    max_examples=settings().max_examples // 4,
    stateful_step_count=20,
    deadline=None,
    suppress_health_check=list(HealthCheck),
)
TestStories = Stories.TestCase
