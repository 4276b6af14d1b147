"""Words of levels that a law lowers and answers raise: what the law takes is no limit's."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import msgspec

from engine_rig import EngineRig
from etd.files.configuration import fake_config
from etd.stabilize.law_settings import PowerLawSettings
from etd.stabilize.settings import Settings
from etd_body.electrode import skin
from felt_scenes import ADAPTS, CAP_UA, N, done, hold, last_ua, ready, say

MakeRig = Callable[..., EngineRig]


def test_a_raised_level_that_a_law_lowers_is_not_held_by_another_limit(make_rig: MakeRig) -> None:
    loaded = fake_config(electrodes=N)
    law = Settings(order=("power_law",), power_law=PowerLawSettings())
    site = msgspec.structs.replace(loaded.body_site, stabilize=law, felt_may_raise=True)
    rig = make_rig(loaded=replace(loaded, body_site=site))
    rig.fake.world.touch(4, skin(800.0, 22_000.0, 0.8))
    ready(rig, CAP_UA, ADAPTS)
    hold(rig, 4_000)
    own_ua = last_ua(rig)
    rig.fake.world.touch(4, skin(1_000.0, 30_000.0, 0.8))
    hold(rig, 4_000)
    lowered_ua = last_ua(rig)
    assert lowered_ua < 0.96 * own_ua
    replies = []
    for _ in range(2):
        replies.append(done(say(rig, "too_weak")))
        hold(rig, 61_000)
    assert {did for did, _ in replies} == {"raises"}
    assert done(say(rig, "too_strong")) == ("lowered", ""), "and no ceiling is made"
