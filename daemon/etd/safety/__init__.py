"""What bounds every pulse: maxima, limits, ledger, soft start, return share, state, lease. Pure: no
I/O, no clock.
"""
