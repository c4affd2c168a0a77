"""What the user states: the plant file, read, checked and simulated."""
