"""A sampled scene: who takes part, where they are at every sample, and its file."""
