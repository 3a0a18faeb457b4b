"""Data acquisition devices of National Instruments: a track's voltage out, forces and torques in, on one clock."""
