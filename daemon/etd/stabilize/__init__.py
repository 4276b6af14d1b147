"""Stabilizers: each may ask for more or less of a pulse, none can widen a limit."""
