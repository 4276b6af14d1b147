"""Figures of Kajimoto's paper, computed with the fake's body model.

A figure is made by a function without arguments, listed in `FIGURES`. It has curves, and checks of
the model against closed forms.
"""
