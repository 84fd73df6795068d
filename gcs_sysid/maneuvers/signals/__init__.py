"""Test inputs of unit amplitude over time: one shape a file. All begin and end at zero."""
