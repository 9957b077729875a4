"""What may be anywhere in a place: a generic field for each, beside the effects that have names."""
