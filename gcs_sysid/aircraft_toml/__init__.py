"""The parts of an aircraft file, each read from its table; `aircraft_file` is the door."""
