"""Models of the effect of a device's pose on skin or on a sensor.

The models are learned, or solve the contact directly.
"""
