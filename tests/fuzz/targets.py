"""All targets there are.

Owns: the list. Must not know: what any of them decodes.
"""

from __future__ import annotations

from fuzz import (
    engine_target,
    file_targets,
    gateway_target,
    message_targets,
    name_target,
    record_target,
    story_target,
    zmtp_target,
)
from fuzz.target import Target

TARGETS: tuple[Target, ...] = (
    *message_targets.TARGETS,
    *zmtp_target.TARGETS,
    *gateway_target.TARGETS,
    *file_targets.TARGETS,
    *name_target.TARGETS,
    *record_target.TARGETS,
    *engine_target.TARGETS,
    *story_target.TARGETS,
)
