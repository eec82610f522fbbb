"""Formulas for a torque that has no name."""
