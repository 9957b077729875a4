"""What a lab of its own adds to bulgefit: an effect, a law and a reader."""
