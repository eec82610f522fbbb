"""The machine file and the options: checked, everything wrong said at once."""
