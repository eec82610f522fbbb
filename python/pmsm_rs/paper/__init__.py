"""The figures of Liu, Liu & Cartes (2008), simulated and identified anew."""

from __future__ import annotations

FIGURES = ("fig5", "fig6", "fig7", "fig8")
"""What can be reproduced."""
