"""One file per chip, named after the part: physical intent to bytes and levels, and back.

A chip driver knows the ports and its datasheet; nothing of electrodes, limits or frames. The fake
types its register maps a second time and imports nothing from here, so one wrong constant shows.
"""
