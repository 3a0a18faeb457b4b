"""Work in other processes: their start and end, and the jobs that they run."""
