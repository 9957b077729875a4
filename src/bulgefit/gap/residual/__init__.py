"""Where does the model miss, how large is the gap, and is what is left more than noise?"""
