"""The process that talks to clients and owns no device.

Owns: sockets, shapes, leases as seen from outside, telemetry. Must not know: boards, limits,
levels.
"""
