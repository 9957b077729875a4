"""Does the diagnosis find what it is not told? Tests with sealed effects, and their score."""
