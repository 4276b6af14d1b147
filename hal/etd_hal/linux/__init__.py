"""The kernel's drivers behind the ports; only this package knows gpiod, spidev, smbus2, time."""
