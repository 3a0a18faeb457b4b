"""From a sampled scene to tracks and their files."""
