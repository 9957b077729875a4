"""Where and why does the model miss, and how far does the gap shrink?"""
