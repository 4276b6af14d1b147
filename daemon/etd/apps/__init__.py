"""Clients that we ship: they talk to the daemon as anybody's program does."""
