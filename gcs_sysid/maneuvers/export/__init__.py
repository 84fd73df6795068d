"""Maneuvers in the forms that autopilots and ground stations take."""
