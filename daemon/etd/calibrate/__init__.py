"""Calibrating a person: procedures, and the way they go over the protocol.

Owns: nothing itself. Must not know: the engine, the gateway, boards. A study program imports what
it needs from here, and can run procedures of its own in the same bounds (`max_gain`, `trial`).
"""
