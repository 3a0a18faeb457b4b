"""Links to the hardware: serial ports, sockets, recordings, capacity."""
