"""One page to open: what was found, with its maps, in a file that holds all it shows."""
