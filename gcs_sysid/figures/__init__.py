"""Figures as data: series, bands, units."""
