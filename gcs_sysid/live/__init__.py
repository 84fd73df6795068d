"""Runs beside the flight: constant cost, bounded memory."""
