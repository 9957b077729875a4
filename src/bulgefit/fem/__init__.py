"""Which shape balances this pressure? Geometrically nonlinear Q4 membranes."""
