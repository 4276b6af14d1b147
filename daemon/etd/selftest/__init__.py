"""The self-test of a board, before it may be armed: stages of growing risk, and a report.

Must not know: ZeroMQ, frames, calibrations of persons. It drives the board through the same guard,
limits and ledger as the engine, and only while no engine runs.
"""
