"""Does the model describe the runs, and which effect is missing?"""
