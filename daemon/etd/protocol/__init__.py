"""What crosses a socket: requests, replies and telemetry of clients, the link between gateway and
engine, errors.
"""
