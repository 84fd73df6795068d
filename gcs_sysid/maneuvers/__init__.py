"""Inputs to fly next: what they excite, what they teach, whether they stay inside the envelope."""
