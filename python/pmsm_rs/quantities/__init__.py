"""Units, the canonical columns, and the words by which files name them."""
