"""Ways to the hardware: serial ports, sockets, recordings, and what they can carry."""
