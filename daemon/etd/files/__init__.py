"""What is read from and written to disk: arrays, body sites, calibrations, configuration, patterns,
paths.
"""
