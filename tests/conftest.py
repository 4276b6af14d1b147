"""For every test: machines are noisy, so no example has a deadline of its own."""

from __future__ import annotations

from hypothesis import settings

settings.register_profile("etd", deadline=None)
settings.load_profile("etd")
