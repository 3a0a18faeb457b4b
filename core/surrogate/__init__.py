"""Surrogate: the effect of a device pose on skin or a sensor, solved directly or learned, behind one interface."""
