"""Custom places: the reader of the key `place` of scenario files, which towns are drawn as, too.

Plain data with their positions in a file (`coopsim.config.checked_entry`) become a `Layout`, or an error that says
where the mistake is. Start in `place.py`, whose docstring lists the keys.
"""
