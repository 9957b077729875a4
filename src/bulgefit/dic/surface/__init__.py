"""What does the measurement say without any model? Strain, curvature and what balances them."""
