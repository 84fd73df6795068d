"""One file a command: its options, the run it calls, the words it ends with."""
