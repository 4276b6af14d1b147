"""What tests of whole models share."""

from __future__ import annotations

from made_rigs import make_rig as make_rig
