"""The demo, the state of an installation, and bundles for bug reports."""
