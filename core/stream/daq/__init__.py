"""Data acquisition devices of National Instruments.

They output the voltage of a track, and read forces and torques, on one clock.
"""
