"""What can be hidden in a simulated flight, one function an effect, grouped by what they act on."""
