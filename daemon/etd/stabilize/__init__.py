"""Stabilizers: each may request more or less than a frame's pulse, none can widen a limit."""
