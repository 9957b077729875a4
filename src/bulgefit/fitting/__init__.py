"""Which parameters fit best, and how sure are we?"""
