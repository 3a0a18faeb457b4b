"""Links to the hardware: serial ports, sockets, recordings, and their capacity."""
