"""What does a diagnosis say in plain words?"""
