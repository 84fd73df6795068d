"""Causes weighed inside the aided filter: the engine of flights in gusts."""
