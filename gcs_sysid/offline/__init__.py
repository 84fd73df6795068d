"""Runs over recorded flights: they tie sources, estimators and documents together."""
