"""How a path is traced: its levels, the next one, what lies between, and how it ends."""
