"""A web page beside a flight: reads what listening writes, and nothing else."""
