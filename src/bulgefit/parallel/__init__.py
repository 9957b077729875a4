"""Where does work run, how do its data get there, and what if a worker dies?"""
