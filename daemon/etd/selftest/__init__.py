"""Whether this board may be put on a person: stages of growing risk, a report, and what follows.

Must not know: ZeroMQ, frames, calibrations of persons. It drives the board through the same guard,
limits and ledger as the engine does, and while no engine has it.
"""
