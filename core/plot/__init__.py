"""Pictures of tracks, pins, stimuli and motors, as SVG and PNG."""
