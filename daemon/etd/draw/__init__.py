"""Pictures of files, as SVG: an array, a board's header, a calibration, a pattern.

Data in, text out: no file is read or written here, and no clock.
"""
