"""Online identification, window by window."""
