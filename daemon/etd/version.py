"""The version of the program, told in `hello`, in calibrations and in reports."""

__version__ = "0.1.0"
