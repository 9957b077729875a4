"""What may a test have that the ideal one has not? One file an effect."""
