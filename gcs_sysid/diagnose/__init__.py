"""What an aircraft file gets wrong about a flight, and which one cause explains it."""
