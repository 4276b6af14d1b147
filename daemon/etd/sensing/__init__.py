"""What is measured of electrodes and supply: contact, impedance, the probe before a pulse, I2C
sensors.
"""
