"""A closed-loop drive that makes recordings."""
