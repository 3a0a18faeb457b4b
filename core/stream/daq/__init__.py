"""Data acquisition devices of National Instruments: output of a track, input of forces."""
