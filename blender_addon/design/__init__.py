"""'How many motors?': settings, answers and their pictures."""
