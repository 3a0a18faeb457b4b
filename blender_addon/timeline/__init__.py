"""What a bake gave, along the frames: the strip in the timeline and its like."""
