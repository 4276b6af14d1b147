"""Calibrating a person: procedures, and presenting their currents over the protocol.

Must not know: the engine, the gateway, boards. A study program can import from here, and run its
own procedures within the same bounds (`reach`, `trial`).
"""
