"""Random machines of right and wrong parts, used in right and wrong ways: each gives an answer or an error.

`tools/misuse.py` runs them by the hour, `tests/scenes/test_random_misuse.py` a few.
"""
