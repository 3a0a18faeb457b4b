"""Live to the hardware: the session, its devices, calibrations and tracks."""
