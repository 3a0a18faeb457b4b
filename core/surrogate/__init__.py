"""Surrogate: what a device pose does to the skin or to a sensor, solved directly or learned, behind one interface."""
