"""Gaussian processes of the aerodynamic coefficients: exact, approximated, incremental."""
