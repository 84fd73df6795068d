"""A JSBSim aircraft to learn from: its truth is known."""
