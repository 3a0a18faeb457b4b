"""Work in other processes: their start and end, and their jobs."""
