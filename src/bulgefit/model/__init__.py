"""What would the camera have seen? Parameters, observation, and the virtual bulge test."""
