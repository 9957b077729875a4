"""What else: how found causes hold elsewhere, what looks like them, what to measure next."""
