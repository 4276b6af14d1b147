"""The figures of the paper that the display follows, from the very model that the fake feels with.

A figure is made by a function without arguments, listed in `FIGURES`; it carries its curves, and
what of them has a closed form is checked against that.
"""
