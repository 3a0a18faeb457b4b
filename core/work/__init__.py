"""Work for other processes: how they are started and ended, and jobs by name that they do."""
