"""Where fingers are put: on surfaces, along gestures, by recordings."""
