"""Pure physics: current source, electrodes, skin. Knows no bus, no chip, no clock, no file."""
