"""Reading: from a file or a frame to a checked recording."""
