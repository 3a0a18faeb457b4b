"""Simulated devices on simulated links, and their faults."""
