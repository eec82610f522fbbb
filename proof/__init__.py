"""Independent simulator of a PMSM drive in phase variables; it makes the recordings the tool is proved on."""
