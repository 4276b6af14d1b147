"""Any script of a person's session, with pauses of up to a minute: its replies tell its pulses."""

from __future__ import annotations

from hypothesis import HealthCheck, given, settings

from person_scripts import check_script, scripts


@settings(deadline=None, max_examples=25, suppress_health_check=[HealthCheck.too_slow])
@given(script=scripts)
def test_the_replies_of_any_script_tell_what_its_pulses_are(
    script: list[tuple[float, list[int], float, float]],
) -> None:
    check_script(script)
