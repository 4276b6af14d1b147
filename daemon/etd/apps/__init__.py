"""Shipped clients; they use the daemon's public protocol, like any program."""
