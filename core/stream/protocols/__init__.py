"""What goes over the wire, one protocol a file."""
