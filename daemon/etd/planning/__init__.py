"""From a frame to pulses that are due: plan, scan rate, headroom, schedule. Pure: no I/O, no
clock.
"""
