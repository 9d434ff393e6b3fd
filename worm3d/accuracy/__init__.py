"""Accuracy on request: `runs` repeats a run until it is as accurate as asked, `estimate` is what it says of itself."""
