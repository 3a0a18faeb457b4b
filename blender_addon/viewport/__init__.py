"""What the 3D view shows: `shown` has it worked out and keeps it; what draws only reads."""
