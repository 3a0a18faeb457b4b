"""From Blender to the engine: who takes part, and where everything is at every sample."""
